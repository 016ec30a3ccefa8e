"""The JSON files of WPILib's SysId, as it wrote them in the seasons of 2022 and 2023.

A file has up to four tests, each a list of rows: for a drivetrain [time, left and right voltage, left and right position, left
and right velocity, heading, gyro rate], for any other mechanism [time, voltage, position, velocity].
Whatever `units` says, rows hold rotations and rotations per second; SysId multiplies them by `unitsPerRotation` when it
analyses them. Source: WPILib, github.com/wpilibsuite/sysid, docs/data-collection.md and
sysid-application/src/main/native/cpp/analysis/AnalysisManager.cpp, which also takes heading and gyro rate as rad and rad/s.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, NoReturn, final

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array, Channel
from servobench.core.errors import FormatError, UsageError
from servobench.core.finding import Finding, info, warning
from servobench.core.units import in_symbols, is_unit, unit
from servobench.recordings.formats.base import FORMATS
from servobench.recordings.formats.stale import stale
from servobench.recordings.formats.sysid_tests import AT_REST, begins_at_rest
from servobench.recordings.formats.times import in_words, time_findings
from servobench.recordings.recording import Recording, Series, Source

TESTS = ("slow-forward", "slow-backward", "fast-forward", "fast-backward")

DRIVETRAIN = (
    Channel(name="time", unit="s"),
    Channel(name="left_voltage", unit="V"),
    Channel(name="right_voltage", unit="V"),
    Channel(name="left_position", unit="rev"),
    Channel(name="right_position", unit="rev"),
    Channel(name="left_velocity", unit="rev/s"),
    Channel(name="right_velocity", unit="rev/s"),
    Channel(name="heading", unit="rad"),
    Channel(name="gyro_rate", unit="rad/s"),
)
MECHANISM = (
    Channel(name="time", unit="s"),
    Channel(name="voltage", unit="V"),
    Channel(name="position", unit="rev"),
    Channel(name="velocity", unit="rev/s"),
)

_TINY = float(
    np.finfo(np.float64).tiny
)  # below it a float is denormal: uninitialised memory, not a measurement


@final
@FORMATS.member("sysid_json")
@dataclass(frozen=True, kw_only=True)
class SysIdJson:
    """WPILib SysId's JSON: a recording for each test. It is read and not written."""

    suffixes: ClassVar[tuple[str, ...]] = (".json",)
    written: ClassVar[tuple[str, ...]] = ()
    by_library: ClassVar[bool] = False

    def recognises(self, path: Path, head: bytes) -> bool:
        """Return whether a file begins like a JSON object with a test of SysId in it."""
        text = head.decode("utf-8-sig", "replace").lstrip()
        return text.startswith("{") and any(f'"{key}"' in text for key in (*TESTS, "sysid"))

    def read(self, path: Path) -> tuple[Recording, ...]:
        """Return a recording for each test in a file; raises `FormatError` where it can't be read."""
        try:
            content = json.loads(path.read_bytes())
        except (ValueError, RecursionError) as error:
            raise FormatError(f"{path.name} isn't JSON, or is damaged: {error}") from None
        if not isinstance(content, dict) or content.get("sysid") is not True:
            has = ", ".join(map(repr, list(content)[:12])) if isinstance(content, dict) else "no object"
            raise FormatError(
                f'{path.name} is JSON, but not of SysId or a servo bench: it lacks "sysid": true and has {has}; '
                "files of its forerunner frc-characterization can be converted in SysId"
            )
        findings = _about_units(content, path.name)
        travel = _travel_per_rev(content)
        recordings = [_recording(key, content[key], path.name, travel) for key in TESTS if content.get(key)]
        if not recordings:
            raise FormatError(f"{path.name} has no test with rows; expected one of {', '.join(TESTS)}")
        return tuple(recording.with_findings(*findings) for recording in recordings)

    def write(self, recordings: tuple[Recording, ...], path: Path) -> NoReturn:
        """Raise `UsageError`: four numbers a row can't hold what a recording knows."""
        raise UsageError(f"{path.name}: SysId files can't be written; write .mcap, .mat or .csv instead")


def _about_units(content: dict[str, Any], name: str) -> list[Finding]:
    """Findings on the unit that the file names beside its rows."""
    units, factor = content.get("units", "Rotations"), content.get("unitsPerRotation", 1.0)
    if not isinstance(units, str) or not isinstance(factor, int | float) or isinstance(factor, bool):
        raise FormatError(
            f"{name}: units are {units!r} and unitsPerRotation {factor!r}; expected a text and a number"
        )
    if units.lower() in {"rotations", "rotation"}:
        return []
    sentence = f"Positions are in rev, as in the file, where a rotation is {factor:g} {units}."
    return [info("units-per-rotation", sentence)]


def _travel_per_rev(content: dict[str, Any]) -> str | None:
    """The travel of a rotation in the unit of the file's user; None for an angle."""
    symbol, factor = str(content.get("units", "")).lower(), float(content.get("unitsPerRotation", 1.0))
    if not is_unit(symbol) or unit(symbol).si != "m" or not 0 < factor < math.inf:
        return None
    return f"{factor!r} {in_symbols(symbol)}"


def _recording(test: str, rows: object, name: str, travel: str | None) -> Recording:
    """The recording of one test, without rows that can't be used."""
    if not isinstance(rows, list):
        raise FormatError(f"{name}: test {test} is {type(rows).__name__}; expected a list of rows")
    widths = [len(row) if isinstance(row, list) else 0 for row in rows]
    channels = {len(known): known for known in (DRIVETRAIN, MECHANISM)}.get(
        max(set(widths), key=widths.count)
    )
    if channels is None:
        raise FormatError(
            f"{name}: test {test} has rows of {max(set(widths), key=widths.count)} numbers; expected "
            f"{len(DRIVETRAIN)} for a drivetrain and {len(MECHANISM)} for any other mechanism"
        )
    good = np.array([_is_row(row, len(channels)) for row in rows])
    findings = []
    if not good.all():
        bad = np.flatnonzero(~good) + 1
        sentence = f"Rows without {len(channels)} numbers are left out: {in_words(bad)}."
        findings.append(warning("row-not-numbers", sentence, rows=(int(bad[0]), int(bad[-1]))))
    numbers = np.flatnonzero(good) + 1
    values = np.array([rows[k] for k in np.flatnonzero(good)], dtype=np.float64).reshape(-1, len(channels))
    with np.errstate(invalid="ignore", over="ignore"):  # a damaged file may have infinities
        positions = tuple(
            replace(each, travel_per_rev=travel) if (each.unit or "").startswith("rev") else each
            for each in channels
        )
    return _clean(test, values, numbers, positions, findings, name)


def _clean(
    test: str,
    values: Array,
    numbers: NDArray[np.int64],
    channels: tuple[Channel, ...],
    findings: list[Finding],
    name: str,
) -> Recording:
    """The recording of rows of numbers (N, M), which stand in the rows `numbers` of the test; `findings` so far."""
    voltages = [k for k, channel in enumerate(channels) if channel.unit == "V"]
    earlier: float | None = None  # the time of a row before the first
    if _first_is_of_another_test(values[:, voltages]):
        findings.append(_first_row_finding(values[0, voltages]))
        earlier = float(values[0, 0])
        values, numbers = values[1:], numbers[1:]
    if not len(values):
        raise FormatError(f"{name}: test {test} has no row that can be used")
    findings.extend(_about_values(values, channels))
    findings.extend(time_findings(values[:, 0], numbers))
    t = np.ascontiguousarray(values[:, 0])
    began = _one_row_earlier(t, earlier)
    series = tuple(
        Series(
            channel=channel,
            values=np.ascontiguousarray(values[:, k]),
            t=began if channel.unit == "V" else t,
        )
        for k, channel in enumerate(channels)
    )
    speeds = [values[:, k] for k, channel in enumerate(channels) if channel.unit == "rev/s"]
    at_rest, of_drivetrain = all(map(begins_at_rest, speeds)), len(channels) == len(DRIVETRAIN)
    return Recording(
        name=test,
        series=series,
        source=Source(name=name, format="sysid_json"),
        starts_at_rest=at_rest,
        findings=(*findings, info("starts-at-rest", AT_REST)) if at_rest else tuple(findings),
        input=None if of_drivetrain else "voltage",
        output=None if of_drivetrain else "position",
    )


def _one_row_earlier(t: Array, before: float | None) -> Array:
    """The times t (N,) [s] of the rows before; that of the first is `before`, or the usual step earlier where it is None."""
    steps = np.diff(t)
    usual = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    return np.concatenate([[t[0] - usual if before is None else before], t[:-1]])


def _is_row(row: object, width: int) -> bool:
    """Whether a row is as many numbers as there are channels; a whole number too large for a float isn't one."""
    return (
        isinstance(row, list)
        and len(row) == width
        and all(type(cell) is float or (type(cell) is int and abs(cell) < 2**1000) for cell in row)
    )


def _first_is_of_another_test(voltages: Array) -> bool:
    """Whether the first row carries a voltage that belongs to the test before.

    Within a test the voltage is constant or a ramp. A first row that differs from the second by more than twice the largest step
    of all others is of neither; only zero makes sense there, as the motor stood still.
    """
    if len(voltages) < 3:
        return False
    steps = np.abs(np.diff(voltages, axis=0))
    strange = (steps[0] > 2 * steps[1:].max(axis=0)) & (voltages[0] != 0)
    return bool(strange.any())


def _first_row_finding(voltages: Array) -> Finding:
    levels = " and ".join(f"{voltage:g} V" for voltage in voltages)
    sentence = f"Row 1 still holds {levels} from the test before, and is left out."
    return info("first-row-other-test", sentence, rows=(1, 1))


def _about_values(values: Array, channels: Sequence[Channel]) -> list[Finding]:
    """Findings on voltages, velocities and positions."""
    findings = []
    sentence = (
        "SysId's logger records the voltage and then sets the next one, so a row's voltage acted up to that row's time: it is "
        "read as acting from the previous row on."
    )
    findings.append(info("voltage-before-row", sentence))
    for k, channel in enumerate(channels):
        column = values[:, k]
        if (
            channel.unit == "rev/s"
            and (unset := np.flatnonzero((column != 0) & (np.abs(column) < _TINY)) + 1).size
        ):
            sentence = (
                f"`{channel.name}` is next to 0 but not 0 ({column[unset[0] - 1]:.4g}) in {len(unset)} rows"
            )
            sentence += ": uninitialised memory, not a measurement."
            findings.append(info("velocity-unset", sentence, rows=(int(unset[0]), int(unset[-1]))))
        if channel.unit == "rev" and (refreshed := stale(column)) is not None:
            findings.append(info("position-stale", refreshed.sentence(channel.name, values[:, 0])))
    return findings
