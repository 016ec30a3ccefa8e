"""servobench: the transfer function of a servo motor, from the motor or a recording of it, and how far to trust it.

The public names are loaded when they are first used, so the import of the package is fast.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from servobench._version import __version__

if TYPE_CHECKING:
    from servobench.export.base import TARGETS as exports
    from servobench.export.summary import load_result
    from servobench.identification.comparison import compare
    from servobench.identification.design.planning import design
    from servobench.identification.estimators.base import ESTIMATORS as estimators
    from servobench.identification.honest.repeatability import honest
    from servobench.identification.identify import identify
    from servobench.identification.models.base import STRUCTURES as structures
    from servobench.identification.reconciliation.reconcile import reconcile
    from servobench.identification.result import Result
    from servobench.identification.simulation import predict, residuals, simulate
    from servobench.identification.trust.validation import validate
    from servobench.identification.why import why
    from servobench.lab.studies.base import STUDIES as studies
    from servobench.recordings.boundedness import bibo
    from servobench.recordings.formats.base import FORMATS as formats
    from servobench.recordings.formats.base import save
    from servobench.recordings.inspection import inspect
    from servobench.recordings.loading.load import load
    from servobench.recordings.measurement.measure import measure
    from servobench.recordings.recording import Recording
    from servobench.report.document import Report
    from servobench.rig.devices.base import DEVICES as devices
    from servobench.rig.devices.base import connect
    from servobench.rig.devices.faults.base import FAULTS as faults
    from servobench.rig.ensemble.ensemble import ensemble
    from servobench.rig.experiment import Experiment
    from servobench.rig.loop.run import run
    from servobench.systems.control.base import CONTROLLERS as controllers
    from servobench.systems.interop import from_control, from_scipy, to_control, to_scipy
    from servobench.systems.signals.base import SIGNALS as signals
    from servobench.systems.signals.chirp import Chirp
    from servobench.systems.signals.constant import Constant
    from servobench.systems.signals.multisine import Multisine
    from servobench.systems.signals.prbs import PRBS
    from servobench.systems.signals.sine import Sine
    from servobench.systems.signals.square import Square
    from servobench.systems.signals.step import Step
    from servobench.systems.stability.verdict import stability
    from servobench.systems.transfer_function import TransferFunction

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
    "compare",
    "connect",
    "controllers",
    "design",
    "devices",
    "ensemble",
    "estimators",
    "exports",
    "faults",
    "formats",
    "from_control",
    "from_scipy",
    "honest",
    "identify",
    "inspect",
    "load",
    "load_result",
    "measure",
    "predict",
    "reconcile",
    "residuals",
    "run",
    "save",
    "signals",
    "simulate",
    "stability",
    "structures",
    "studies",
    "to_control",
    "to_scipy",
    "validate",
    "why",
]

_HOMES = {
    "PRBS": "servobench.systems.signals.prbs",
    "Chirp": "servobench.systems.signals.chirp",
    "Constant": "servobench.systems.signals.constant",
    "Experiment": "servobench.rig.experiment",
    "Multisine": "servobench.systems.signals.multisine",
    "Recording": "servobench.recordings.recording",
    "Report": "servobench.report.document",
    "Result": "servobench.identification.result",
    "Sine": "servobench.systems.signals.sine",
    "Square": "servobench.systems.signals.square",
    "Step": "servobench.systems.signals.step",
    "TransferFunction": "servobench.systems.transfer_function",
    "bibo": "servobench.recordings.boundedness",
    "compare": "servobench.identification.comparison",
    "connect": "servobench.rig.devices.base",
    "design": "servobench.identification.design.planning",
    "ensemble": "servobench.rig.ensemble.ensemble",
    "from_control": "servobench.systems.interop",
    "from_scipy": "servobench.systems.interop",
    "honest": "servobench.identification.honest.repeatability",
    "identify": "servobench.identification.identify",
    "inspect": "servobench.recordings.inspection",
    "load": "servobench.recordings.loading.load",
    "load_result": "servobench.export.summary",
    "measure": "servobench.recordings.measurement.measure",
    "predict": "servobench.identification.simulation",
    "reconcile": "servobench.identification.reconciliation.reconcile",
    "residuals": "servobench.identification.simulation",
    "run": "servobench.rig.loop.run",
    "save": "servobench.recordings.formats.base",
    "simulate": "servobench.identification.simulation",
    "stability": "servobench.systems.stability.verdict",
    "to_control": "servobench.systems.interop",
    "to_scipy": "servobench.systems.interop",
    "validate": "servobench.identification.trust.validation",
    "why": "servobench.identification.why",
}

_KINDS = {
    "controllers": ("servobench.systems.control.base", "CONTROLLERS"),
    "devices": ("servobench.rig.devices.base", "DEVICES"),
    "estimators": ("servobench.identification.estimators.base", "ESTIMATORS"),
    "exports": ("servobench.export.base", "TARGETS"),
    "faults": ("servobench.rig.devices.faults.base", "FAULTS"),
    "formats": ("servobench.recordings.formats.base", "FORMATS"),
    "signals": ("servobench.systems.signals.base", "SIGNALS"),
    "structures": ("servobench.identification.models.base", "STRUCTURES"),
    "studies": ("servobench.lab.studies.base", "STUDIES"),
}
"""The lists: `signals` at the prompt shows a line for each signal, `signals["square"]` is one."""


def __getattr__(name: str) -> object:
    """Load a public name where it lives (PEP 562)."""
    if name in _KINDS:
        home, inside = _KINDS[name]
    elif name in _HOMES:
        home, inside = _HOMES[name], name
    else:
        raise AttributeError(f"module 'servobench' has no attribute {name!r}; it has {', '.join(__all__)}")
    value = getattr(import_module(home), inside)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
