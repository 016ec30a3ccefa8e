"""servobench: from a servo motor, or a recording of one, to its transfer function, and how far to trust it.

The public names are loaded when they are first used, so that importing the package costs next to nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from servobench._version import __version__

if TYPE_CHECKING:
    from servobench.devices.base import connect
    from servobench.experiment import Experiment
    from servobench.formats.base import load, save
    from servobench.identification import identify
    from servobench.interop import from_control, from_scipy, to_control, to_scipy
    from servobench.loop.run import run
    from servobench.measurement.measure import measure
    from servobench.reconciliation.asking import reconcile, why
    from servobench.recording.recording import Recording
    from servobench.report.document import Report
    from servobench.result import Result
    from servobench.signals.chirp import Chirp
    from servobench.signals.constant import Constant
    from servobench.signals.multisine import Multisine
    from servobench.signals.prbs import PRBS
    from servobench.signals.sine import Sine
    from servobench.signals.square import Square
    from servobench.signals.step import Step
    from servobench.simulation import predict, residuals, simulate
    from servobench.stability_analysis.record import bibo
    from servobench.stability_analysis.verdict import stability
    from servobench.transfer_function import TransferFunction
    from servobench.validation import validate

__all__ = [
    "PRBS",
    "Chirp",
    "Constant",
    "Experiment",
    "Multisine",
    "Recording",
    "Report",
    "Result",
    "Sine",
    "Square",
    "Step",
    "TransferFunction",
    "__version__",
    "bibo",
    "connect",
    "from_control",
    "from_scipy",
    "identify",
    "load",
    "measure",
    "predict",
    "reconcile",
    "residuals",
    "run",
    "save",
    "simulate",
    "stability",
    "to_control",
    "to_scipy",
    "validate",
    "why",
]

_HOMES = {
    "PRBS": "servobench.signals.prbs",
    "Chirp": "servobench.signals.chirp",
    "Constant": "servobench.signals.constant",
    "Experiment": "servobench.experiment",
    "Multisine": "servobench.signals.multisine",
    "Recording": "servobench.recording.recording",
    "Report": "servobench.report.document",
    "Result": "servobench.result",
    "Sine": "servobench.signals.sine",
    "Square": "servobench.signals.square",
    "Step": "servobench.signals.step",
    "TransferFunction": "servobench.transfer_function",
    "bibo": "servobench.stability_analysis.record",
    "connect": "servobench.devices.base",
    "from_control": "servobench.interop",
    "from_scipy": "servobench.interop",
    "identify": "servobench.identification",
    "load": "servobench.formats.base",
    "measure": "servobench.measurement.measure",
    "predict": "servobench.simulation",
    "reconcile": "servobench.reconciliation.asking",
    "residuals": "servobench.simulation",
    "run": "servobench.loop.run",
    "save": "servobench.formats.base",
    "simulate": "servobench.simulation",
    "stability": "servobench.stability_analysis.verdict",
    "to_control": "servobench.interop",
    "to_scipy": "servobench.interop",
    "validate": "servobench.validation",
    "why": "servobench.reconciliation.asking",
}


def __getattr__(name: str) -> object:
    """Load a public name where it lives (PEP 562)."""
    if name not in _HOMES:
        raise AttributeError(f"module 'servobench' has no attribute {name!r}; it has {', '.join(__all__)}")
    value = getattr(import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
