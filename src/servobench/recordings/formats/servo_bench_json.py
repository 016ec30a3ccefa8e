"""The JSON files of servo benches with a pendulum, as Rhoban's bam writes them.

An object with the bench's settings (`mass` [kg], `length` [m], `kp` of the servo's own controller, `vin` [V], `motor`,
`trajectory`) and `entries`, one for each reading: position and goal_position [rad], speed [rad/s], input_volts [V], temp [°C],
timestamp [s], load (a raw number of the servo's register) and torque_enable. Source: Rhoban, github.com/Rhoban/bam.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, NoReturn, final

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array, Channel, DeviceInfo
from servobench.core.errors import FormatError, UsageError
from servobench.core.finding import Finding, info, warning
from servobench.recordings.formats.base import FORMATS
from servobench.recordings.formats.columns import quote
from servobench.recordings.formats.times import in_words, time_findings
from servobench.recordings.recording import Recording, Series, Source

_UNITS = {"position": "rad", "goal_position": "rad", "speed": "rad/s", "input_volts": "V", "timestamp": "s"}
_NAMES = {"input_volts": "supply_voltage"}  # it would be taken for the motor's input, which it isn't
_MARKS = ("goal_position", "torque_enable", "input_volts")
_TIME = "timestamp"
_MOST_CHANNELS = 100
_GRAVITY = 9.81  # m/s²
_SETTING_UNITS = {"mass": "kg", "length": "m", "vin": "V"}


@final
@FORMATS.member("servo_bench_json")
@dataclass(frozen=True, kw_only=True)
class ServoBenchJson:
    """JSON of a servo bench: one recording. It is read and not written."""

    suffixes: ClassVar[tuple[str, ...]] = (".json",)
    written: ClassVar[tuple[str, ...]] = ()
    by_library: ClassVar[bool] = False

    def recognises(self, path: Path, head: bytes) -> bool:
        """Return whether a file begins like a JSON object with a servo's readings in it."""
        text = head.decode("utf-8-sig", "replace").lstrip()
        return text.startswith("{") and '"entries"' in text and any(f'"{mark}"' in text for mark in _MARKS)

    def read(self, path: Path) -> tuple[Recording, ...]:
        """Return the recording; the file doesn't say which channel is the input. Raises `FormatError`."""
        try:
            content = json.loads(path.read_bytes())
        except (ValueError, RecursionError) as error:
            raise FormatError(f"{path.name} isn't JSON, or is damaged: {error}") from None
        entries = content.get("entries") if isinstance(content, dict) else None
        if not isinstance(entries, list) or not any(isinstance(entry, dict) for entry in entries):
            has = (
                ", ".join(map(repr, list(content)[:12])) or "nothing"
                if isinstance(content, dict)
                else "no object"
            )
            raise FormatError(
                f'{path.name} is JSON, but not of SysId or a servo bench: it lacks "sysid": true or a list of readings called '
                f"`entries`, and has {has}"
            )
        return (_recording(content, entries, path),)

    def write(self, recordings: tuple[Recording, ...], path: Path) -> NoReturn:
        """Raise `UsageError`: a list of readings can't hold what a recording knows."""
        raise UsageError(
            f"{path.name}: files of servo benches can't be written; write .mcap, .mat or .csv instead"
        )


def _recording(content: Mapping[str, Any], entries: Sequence[Any], path: Path) -> Recording:
    names = _names(entries)
    if _TIME not in names:
        raise FormatError(f"{path.name}: its readings have no `{_TIME}`; they have {quote(names)}")
    good = np.array([_is_reading(entry, names) for entry in entries])
    rows = np.flatnonzero(good) + 1
    findings: list[Finding] = []
    if not good.all():
        bad = np.flatnonzero(~good) + 1
        sentence = f"Not a number for each of {quote(names)}, left out: {in_words(bad)}."
        findings.append(warning("row-not-numbers", sentence, rows=(int(bad[0]), int(bad[-1]))))
    values = {
        name: np.array([entries[k][name] for k in np.flatnonzero(good).tolist()], dtype=np.float64)
        for name in names
    }
    if "load" in values:
        values["load"], load_findings = _load(values["load"], rows)
        findings.extend(load_findings)
    if "torque_enable" in values:
        findings.extend(_about_torque(values["torque_enable"], rows))
    settings = {key: value for key, value in content.items() if isinstance(value, str | int | float)}
    findings.extend(_about_bench(settings, values))
    t = values[_TIME]
    findings.extend(time_findings(t, rows))
    channels = tuple(Channel(name=_NAMES.get(name, name), unit=_UNITS.get(name)) for name in names)
    series = tuple(
        Series(channel=channel, values=values[name], t=t)
        for name, channel in zip(names, channels, strict=True)
    )
    device = DeviceInfo(
        name=str(settings.get("motor", "servo")),
        channels=channels,
        timing="host",
        settings=tuple((key, _with_unit(key, value)) for key, value in settings.items()),
    )
    source = Source(name=path.name, format="servo_bench_json")
    return Recording(name=path.stem, series=series, source=source, info=device, findings=tuple(findings))


def _names(entries: Sequence[Any]) -> list[str]:
    """The names of what the first reading has numbers for, the time first."""
    first = next(entry for entry in entries if isinstance(entry, dict))
    names = [name for name, value in first.items() if _is_number(value)][:_MOST_CHANNELS]
    return sorted(names, key=lambda name: name != _TIME)


def _is_number(value: object) -> bool:
    """Whether a value is a number or a truth value; a whole number too large for a float isn't."""
    return isinstance(value, float) or (isinstance(value, int) and abs(value) < 2**1000)


def _is_reading(entry: object, names: Sequence[str]) -> bool:
    return isinstance(entry, dict) and all(_is_number(entry.get(name)) for name in names)


def _with_unit(key: str, value: object) -> str:
    unit = _SETTING_UNITS.get(key)
    return f"{value} {unit}" if unit and not isinstance(value, str) else str(value)


def _load(values: Array, rows: NDArray[np.int64]) -> tuple[Array, list[Finding]]:
    """The load with its sign, and what is to be known of it."""
    if not len(values) or not values.any():
        sentence = (
            "`load` is 0 in every row: the servo didn't report it, so the motor's voltage and torque "
            "aren't known."
        )
        return values, [info("load-zero", sentence)]
    findings = []
    whole = bool((values == np.rint(values)).all()) and values.min() >= 0 and values.max() < 2**16
    wrapped = (values >= 2**15) if whole else np.zeros(len(values), dtype=bool)
    if wrapped.any():
        there = rows[wrapped]
        sentence = f"`load` is signed and was written as 0 to 65535 (65535 is -1); its sign is restored in {in_words(there)}."
        findings.append(info("load-unwrapped", sentence, rows=(int(there[0]), int(there[-1]))))
        values = np.where(wrapped, values - 2**16, values)
    sentence = (
        "`load` is the servo's raw register for the motor's duty, not a torque: load × supply is the motor's "
        "voltage, up to a scale given in the servo's manual."
    )
    return values, [*findings, info("load-raw", sentence)]


def _about_torque(on: Array, rows: NDArray[np.int64]) -> list[Finding]:
    off = rows[on == 0]
    if not len(off):
        return []
    if len(off) == len(rows):
        sentence = "The servo's torque was off all the time (`torque_enable` is 0): nothing drove the motor."
    else:
        sentence = (
            f"The servo's torque was off in {in_words(off)} (`torque_enable` is 0): neither the target nor a voltage "
            "drove the motor there. Fit the rows before and after separately."
        )
    return [warning("torque-off", sentence, rows=(int(off[0]), int(off[-1])))]


def _about_bench(settings: Mapping[str, Any], values: Mapping[str, Array]) -> list[Finding]:
    findings = []
    if settings:
        text = ", ".join(f"{key} {_with_unit(key, value)}" for key, value in list(settings.items())[:12])
        findings.append(info("bench-settings", f"The file describes its bench: {text}."))
    mass, length = settings.get("mass"), settings.get("length")
    if _is_number(mass) and _is_number(length) and 0 < float(mass) * float(length) < 1e6:  # type: ignore[arg-type]
        torque = float(mass) * _GRAVITY * float(length)  # type: ignore[arg-type]
        sentence = (
            f"A mass hangs on the shaft: gravity acts on it with up to {torque:.3g} N·m, proportional to the sine of "
            "the angle. Use a model with gravity."
        )
        findings.append(info("bench-pendulum", sentence))
    if "input_volts" in values:
        findings.append(info("supply-voltage", _supply(values["input_volts"])))
    if "goal_position" in values:
        sentence = (
            "`goal_position` is the target of the servo's internal position loop, with its gain `kp`. With it as "
            "the input, the model describes the motor with that loop."
        )
        findings.append(info("goal-of-inner-loop", sentence))
    return findings


def _supply(volts: Array) -> str:
    span = f", here {volts.min():g} to {volts.max():g} V" if len(volts) else ""
    return (
        f"`input_volts` of the file, here `supply_voltage`, is the voltage of the supply{span}, not the "
        "voltage that drives the motor."
    )
