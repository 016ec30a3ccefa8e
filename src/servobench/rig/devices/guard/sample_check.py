"""The check of a device's answers before they are used: finite numbers in a sample, and a voltage that it can put out."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Self

from servobench.core.channels import DeviceInfo, Sample
from servobench.rig.devices.base import value_text, voltage_or_nan
from servobench.rig.devices.guard.base import Alarm

_LARGEST = 2**63  # a 64-bit counter's; the laws count in such integers
_LARGEST_VOLTAGE = 1e6  # V; beyond what any amplifier puts out, where a device states no range
_ROUNDING = 1e-3  # of the range; single precision and a reading back in three digits stay within it
_SENSORS = {"counts": "encoder", "time": "clock", "tachometer": "tachometer", "current": "current sensor"}


def unusable(sample: Sample) -> Alarm | None:
    """Return the alarm for a sample in which a value is no finite number; None where each is one, or isn't measured."""
    counts, time, speed, current = sample.counts, sample.time, sample.tachometer, sample.current
    if (  # the types that a driver should use, without a call: this is done in every tick
        type(counts) is int
        and -_LARGEST <= counts < _LARGEST
        and type(time) is float
        and -math.inf < time < math.inf
        and (speed is None or (type(speed) is float and -math.inf < speed < math.inf))
        and (current is None or (type(current) is float and -math.inf < current < math.inf))
    ):
        return None
    for name, sensor in _SENSORS.items():
        value = getattr(sample, name)
        optional = name in ("tachometer", "current")
        if not (value is None and optional) and not _is_usable(value, name):
            return Alarm(
                "sample-not-finite",
                f"the device gave {value_text(value)} as its {name}; expected a finite number. Check its {sensor}, "
                "the cable, and the driver that reads it",
            )
    return None


def recordable(sample: Sample) -> Sample | None:
    """Return a sample as a recording can hold it: NaN for what is no number. None where it doesn't say when it was taken."""
    time = voltage_or_nan(sample.time)
    if not math.isfinite(time):
        return None
    values = {
        name: None if getattr(sample, name) is None else voltage_or_nan(getattr(sample, name))
        for name in ("tachometer", "current")
    }
    usable = _is_usable(sample.counts, "counts")
    counts = sample.counts if usable else voltage_or_nan(sample.counts)
    return replace(sample, counts=counts, time=time, **values)  # type: ignore[arg-type]


@dataclass(frozen=True, kw_only=True)
class Answers:
    """Check the return value of a device's `write`: the voltage that it puts out, within its range."""

    device: str
    """The device's name."""
    unit: str
    """The unit of what it puts out."""
    lowest: float
    """The lower end of its range [unit]."""
    highest: float
    """The upper end of its range [unit]."""
    margin: float
    """The distance beyond the range that is still rounding [unit]."""

    @classmethod
    def of(cls, info: DeviceInfo) -> Self:
        """Return those of a device: within its own range to its resolution, and to 0.1 % of the range at least."""
        channel = info.channel("voltage")
        lowest, highest = (channel.minimum, channel.maximum) if channel else (None, None)
        resolution = (channel.resolution if channel else None) or 0.0
        stated = lowest is not None and highest is not None
        return cls(
            device=info.name,
            unit=(channel.unit if channel else None) or "V",
            lowest=-_LARGEST_VOLTAGE if lowest is None else lowest,
            highest=_LARGEST_VOLTAGE if highest is None else highest,
            margin=max(resolution, _ROUNDING * (highest - lowest) if stated else 0.0),  # type: ignore[operator]
        )

    def wrong(self, answer: object) -> Alarm | None:
        """Return the alarm for an answer that is no finite number, or beyond the range; None where it may be one."""
        if type(answer) is float and self.lowest <= answer <= self.highest:  # in every tick
            return None
        voltage = voltage_or_nan(answer)
        returned = f"write() of the device {self.device!r} returned {value_text(answer)}"
        if not math.isfinite(voltage):
            return Alarm(
                "applied-not-finite",
                f"{returned}; expected a finite number in {self.unit}. Check its driver",
            )
        if self.lowest - self.margin <= voltage <= self.highest + self.margin:
            return None
        return Alarm(
            "applied-beyond-range",
            f"{returned}, beyond its range of {self.lowest:g} to {self.highest:g} {self.unit}; check its driver",
        )


def _is_usable(value: object, name: str) -> bool:
    number = voltage_or_nan(value)
    return math.isfinite(number) and (name != "counts" or -_LARGEST <= number < _LARGEST)
