"""The document that `servobench stability --json` prints: its sentences as plain data of the schema `servobench.stability/1`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from servobench.identification.uncertainty.stability import OverIntervals
    from servobench.recordings.boundedness import RecordReport, Slope, Stretch
    from servobench.recordings.measurement.dataset import Dataset
    from servobench.systems.margins import Margins
    from servobench.systems.stability.drive import Drive
    from servobench.systems.stability.proportional import ProportionalLoop
    from servobench.systems.stability.verdict import StabilityReport
    from servobench.systems.transfer_function import TransferFunction

SCHEMA = "servobench.stability/1"


def of_a_system(system: TransferFunction, report: StabilityReport) -> dict[str, Any]:
    """Return the verdict on a system, its poles [1/s], the reasons, and an input that drives it off."""
    return {
        "output": system.output,
        "verdict": report.verdict,
        "bibo": report.bibo,
        "poles": [
            {"real": pole.real, "imaginary": pole.imag, "multiplicity": times}
            for pole, times in zip(report.poles, report.multiplicities, strict=True)
        ],
        "reasons": list(report.reasons),
        "drive": None if report.drive is None else _drive(system, report.drive),
    }


def _drive(system: TransferFunction, drive: Drive) -> dict[str, Any]:
    sinusoid = drive.rate == 0 and drive.pole.imag != 0
    power = {0: "", 1: "/s"}.get(drive.power, f"/s^{drive.power}")
    return {
        "input": "sinusoid" if sinusoid else "constant",
        "frequency": abs(drive.pole.imag) if sinusoid else None,
        "coefficient": {"value": drive.coefficient, "unit": f"{system.unit}{power}"},
        "power": drive.power,
        "rate": drive.rate,
        "sentence": drive.sentence,
    }


def of_a_loop(gain: float, unit: str, loop: ProportionalLoop, sentences: Sequence[str]) -> dict[str, Any]:
    """Return the verdict on a position loop of a gain, and its margins."""
    closed, factors = loop.closed, loop.stable_factors
    return {
        "gain": {"value": gain, "unit": unit},
        "sample_time": loop.sample_time,
        "verdict": closed.verdict,
        "poles_right": {"open": closed.open_right, "closed": closed.right},
        "encirclements": closed.encirclements,
        "margins": None if loop.margins is None else _margins(loop.margins, loop.delay_margin),
        "stable_factors": None if factors is None else [list(each) for each in factors],
        "sentences": list(sentences),
    }


def _margins(loop_margins: Margins, delay: float | None) -> dict[str, Any]:
    margins = {
        "gain_margin": (loop_margins.gain_margin, "1"),
        "phase_margin": (loop_margins.phase_margin, "rad"),
        "delay_margin": (delay, "s"),
        "gain_crossover": (loop_margins.gain_crossover, "rad/s"),
        "phase_crossover": (loop_margins.phase_crossover, "rad/s"),
    }
    return {name: {"value": value, "unit": unit} for name, (value, unit) in margins.items()}


def of_a_record(data: Dataset, report: RecordReport) -> dict[str, Any]:
    """Return what a record says, each quantity with its unit."""
    return {
        "source": data.name,
        "duration": data.duration,
        "input_bound": {"value": report.input_bound, "unit": data.input_unit},
        "output_range": {"interval": list(report.output_range), "unit": data.output_unit},
        "stretches": [_stretch(data, each) for each in report.stretches],
        "sentences": list(report.sentences),
    }


def _stretch(data: Dataset, stretch: Stretch) -> dict[str, Any]:
    return {
        "start": stretch.start,
        "end": stretch.end,
        "level": {"value": stretch.level, "unit": data.input_unit},
        "slopes": [_slope(each, f"{data.output_unit}/s".replace("/s/s", "/s²")) for each in stretch.slopes],
        "exponent": None if stretch.exponent is None else list(stretch.exponent),
        "sentence": stretch.sentence,
    }


def _slope(slope: Slope, unit: str) -> dict[str, Any]:
    interval = [slope.value - slope.half, slope.value + slope.half]
    return {"value": slope.value, "interval": interval, "level": 0.95, "unit": unit}


def over_intervals(what: str, verdict: OverIntervals) -> dict[str, Any]:
    """Return whether a verdict holds for all parameters that the data leave open."""
    return {
        "of": what,
        "verdict": verdict.verdict,
        "everywhere": verdict.everywhere,
        "share": verdict.share if math.isfinite(verdict.share) else None,
        "draws": verdict.draws,
        "corners": verdict.corners,
        "corners_alike": verdict.corners_alike,
        "undetermined": list(verdict.undetermined),
        "sentence": verdict.sentence,
    }
