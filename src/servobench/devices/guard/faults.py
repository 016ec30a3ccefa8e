"""Faults: why a motor was stopped, kept until somebody has seen to it; and those that are no monitor's."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from servobench.devices.guard.base import Alarm
from servobench.finding import Finding, info, warning

_DOUBTFUL = (
    "encoder-",
    "wraps-",
    "applied-",
    "stop-",
)  # what was measured before such a fault may be wrong, too


@dataclass(frozen=True, kw_only=True)
class Fault:
    """Why a motor was stopped: a stable code, what happened as a sentence, and the run's time of it [s]."""

    code: str
    sentence: str
    time: float

    @classmethod
    def of(cls, alarm: Alarm, time: float) -> Fault:
        """Return the fault that an alarm at that time [s] is."""
        sentence = f"the motor was stopped at {time:.4g} s: {alarm.sentence}"
        return cls(code=alarm.code, sentence=sentence, time=time)


def faults_found(faults: Iterable[Fault], told: Iterable[Finding]) -> list[Finding]:
    """Return a finding for each fault, but for those whose code has been told already."""
    known = {finding.code for finding in told}
    return [
        (warning if fault.code.startswith(_DOUBTFUL) else info)(fault.code, f"Fault: {fault.sentence}.")
        for fault in faults
        if fault.code not in known
    ]


def saturated(samples: int) -> Finding:
    """Return that voltages were limited."""
    return info(
        "saturated",
        f"At {samples} samples another voltage was put out than commanded, by a limit of the experiment or of the device; what "
        "was put out is what is identified.",
    )


def starved(silent: float, timeout: float) -> Alarm:
    """Return that nobody drove for some time, longer than the timeout [s]."""
    return Alarm(
        "watchdog",
        f"no new voltage came for {1000 * silent:.3g} ms after a new sample (limit: {1000 * timeout:g} ms); find what held the "
        "loop up, or raise limits.watchdog.timeout",
    )


def no_voltage(voltage: object) -> Alarm:
    """Return that something was to be written that is no voltage."""
    given = repr(voltage)
    shown = given if len(given) <= 40 else f"{given[:37]}..."
    return Alarm("voltage-not-finite", f"{shown} is no voltage; expected a finite number in V")


def no_answer(applied: float) -> Alarm:
    """Return that the device gave back something that is no voltage."""
    return Alarm("applied-not-finite", f"the device says that it puts out {applied} V; look at its driver")


def not_stopped(error: BaseException) -> Alarm:
    """Return that the device's own stop failed."""
    return Alarm(
        "stop-failed",
        f"the device's own stop failed ({error!r}), so nothing more is written to it, for its own watchdog to stop it; take the "
        "motor's supply away",
    )
