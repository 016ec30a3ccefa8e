"""Values that no servo motor has: usually a wrong unit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from servobench.core.finding import Finding, warning
from servobench.core.rounding import plain, with_unit
from servobench.identification.estimators.base import Fit
from servobench.identification.models.motion import smooth_speed
from servobench.identification.trust.doubts.base import DOUBTS, Doubt
from servobench.identification.trust.doubts.lattice import lattice_step
from servobench.recordings.formats.likely_units import LARGEST_SUPPLY
from servobench.recordings.formats.supply import WHOLE
from servobench.recordings.measurement.dataset import Dataset

_FASTEST = 3500.0  # rad/s, 33,000 rpm: small motors with an encoder reach it; a servo motor in degrees seems to go beyond
_VOLTAGES = (0.05, 1000.0)  # V: less moves no motor, more is for locomotives
_SLOWEST = 30.0  # s: a time constant of half a minute is a flywheel's
_RARELY = 0.5  # s between samples
_VAGUELY = 1.5  # times: so far an interval may reach whose middle is too short
_QUICKEST = 5e-4  # s: the smallest motors without iron take a millisecond to get up to speed


def _about_data(records: Sequence[Dataset]) -> list[Finding]:
    findings = []
    for data in records:
        findings += [*_input_size(data), *_speed(data)]
    return findings[:2]


def _input_size(data: Dataset) -> list[Finding]:
    largest = float(np.abs(data.u).max(initial=0.0))
    if any(f.code == "unit-contradicted" and "coulomb_voltage" in f.parameters for f in data.findings):
        return []
    if data.input_unit == "%" and largest > 100.0 * WHOLE:
        sentence = (
            f"{data.name}: the duty reaches {plain(largest, 4)} %, more than the whole: these may be steps of a timer. "
            "Give the count that is 100 %, as in `input=COL:PWM/255` or `input=COL:PWM/1023`, or the unit: `input=COL:UNIT`."
        )
        return [warning("size-absurd", sentence, parameters=("gain", "coulomb_voltage"))]
    if data.input_unit != "V" or largest == 0:
        return []
    if LARGEST_SUPPLY < largest <= _VOLTAGES[1] and bool((data.u == np.rint(data.u)).all()):
        sentence = (
            f"{data.name}: the input reaches {plain(largest, 4)} V in whole numbers only, like raw counts of a pulse width "
            "and unlike most voltages. If 255 of them are 100 %, say `input=COL:PWM/255`, with the supply: `supply=...`."
        )
        return [warning("size-absurd", sentence, parameters=("gain", "coulomb_voltage"))]
    if _VOLTAGES[0] <= largest <= _VOLTAGES[1]:
        return []
    other = "V read as mV" if largest < 1 else "mV or raw counts read as V, or input and output swapped"
    sentence = (
        f"{data.name}: the input reaches {plain(largest, 3)} V, which no servo motor is driven with "
        f"({other}?). Check the column and its unit: `input=COL:UNIT`."
    )
    return [warning("size-absurd", sentence, parameters=("gain", "coulomb_voltage"))]


def _speed(data: Dataset) -> list[Finding]:
    if data.position_unit != "rad" or len(data.y) < 3:
        return []
    fastest = float(np.percentile(np.abs(smooth_speed(_as_counts(data))), 95))
    if fastest <= _FASTEST:
        return []
    sentence = (
        f"{data.name}: the motor seems to turn at {plain(fastest, 3)} rad/s ({plain(fastest * 30 / np.pi, 3)} "
        "rpm), faster than nearly any servo motor: degrees or counts may have been read as radians, or "
        "milliseconds as seconds. Check the units: `output=COL:UNIT`, `time=COL:UNIT`."
    )
    return [warning("size-absurd", sentence, parameters=("gain",))]


def _as_counts(data: Dataset) -> Dataset:
    """The record as counts, where its values are steps of a sensor: the speed from one step to the next is no motor's."""
    step = data.quantum or lattice_step(data.y)
    if step is None:
        return data
    if data.kind == "position":
        return replace(data, quantum=step)
    position = np.cumsum(data.y) * data.sample_time
    return replace(
        data,
        kind="position",
        output_unit=data.position_unit,
        y=position,
        quantum=step * data.sample_time,
        reference=None,
    )


def _about_fit(fit: Fit) -> list[Finding]:
    if "time_constant" not in fit.model.names:
        return []
    tau = fit["time_constant"]
    if tau.interval[1] < _QUICKEST or (tau.value < _QUICKEST and tau.interval[1] < _VAGUELY * _QUICKEST):
        sentence = (
            f"The time constant comes out below {with_unit(tau.interval[1], 's', 2)}, too short for any motor: seconds may have "
            "been read as milliseconds. Check the unit of the times: `time=COL:s` for a column, or seconds for arrays."
        )
        return [warning("size-absurd", sentence, parameters=("time_constant", "gain"))]
    longest = max(record.data.duration for record in fit.records)
    # A record in which a motor hardly gets anywhere says little of a long time constant, unless its samples are far apart, too.
    slowly = min(record.data.sample_time for record in fit.records) >= _RARELY
    if tau.value <= _SLOWEST or tau.sd > 0.5 * tau.value or not (slowly or tau.value <= 0.5 * longest):
        return []
    name, symbol = ("microseconds", "us") if 1e-3 * tau.value > _SLOWEST else ("milliseconds", "ms")
    sentence = (
        f"The time constant comes out as {plain(tau.value, 3)} s, too long for a servo motor: "
        f"{name} may have been read as seconds. Check the unit of the times: "
        f"`time=COL:{symbol}` for a column, or seconds in place of {name} for arrays."
    )
    return [warning("size-absurd", sentence, parameters=("time_constant", "gain"))]


DOUBTS.member("size")(Doubt(codes=("size-absurd",), about_data=_about_data, about_fit=_about_fit))
