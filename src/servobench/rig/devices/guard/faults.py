"""Faults: why a motor was stopped, kept until they are acknowledged; and those without a monitor."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from servobench.core.finding import Finding, danger, info, warning
from servobench.core.rounding import milliseconds
from servobench.rig.devices.base import error_text, value_text
from servobench.rig.devices.guard.base import Alarm

_DOUBTFUL = (
    "encoder-",
    "wraps-",
    "applied-",
)  # what was measured before such a fault may be wrong, too


NOT_STOPPED = "stop-failed"


@dataclass(frozen=True, kw_only=True)
class Fault:
    """The reason why a motor was stopped: a stable code, what happened as a sentence, and the run's time of it [s]."""

    code: str
    sentence: str
    time: float

    @classmethod
    def of(cls, alarm: Alarm, time: float) -> Fault:
        """Return the fault that an alarm at that time [s] is."""
        begins = (
            f"at {time:.4g} s" if alarm.code == NOT_STOPPED else f"the motor was stopped at {time:.4g} s:"
        )
        sentence = f"{begins} {alarm.sentence}"
        return cls(code=alarm.code, sentence=sentence, time=time)


def faults_found(faults: Iterable[Fault], findings: Iterable[Finding]) -> list[Finding]:
    """Return a finding for each fault whose code hasn't been reported yet."""
    known = {finding.code for finding in findings}
    return [_finding(fault) for fault in faults if fault.code not in known]


def _finding(fault: Fault) -> Finding:
    if fault.code == NOT_STOPPED:
        return danger(fault.code, f"SWITCH OFF THE SUPPLY: {fault.sentence}.")
    return (warning if fault.code.startswith(_DOUBTFUL) else info)(fault.code, f"Fault: {fault.sentence}.")


def saturation_finding(samples: int) -> Finding:
    """Return that voltages were limited."""
    return info(
        "saturated",
        f"At {samples} samples the applied voltage differed from the command, because of a limit of the experiment "
        "or the device; the identification uses the applied voltage.",
    )


def starvation_alarm(silent: float, timeout: float) -> Alarm:
    """Return the fault that the device wasn't driven for longer than the timeout [s]."""
    return Alarm(
        "watchdog",
        f"no new voltage came for {milliseconds(silent)} ms after a new sample (limit: {1000 * timeout:g} ms); find "
        "what delayed the loop, or raise limits.watchdog.timeout",
    )


def no_voltage(voltage: object) -> Alarm:
    """Return that something was to be written that is no voltage."""
    return Alarm(
        "voltage-not-finite", f"{value_text(voltage)} isn't a voltage; expected a finite number in V"
    )


def not_stopped(error: BaseException, *, zero_volts: bool) -> Alarm:
    """Return that the device's own stop failed; `zero_volts`: whether it had taken a write of 0 V before."""
    known = "a write of zero volts had returned before" if zero_volts else "zero volts were not confirmed"
    return Alarm(
        NOT_STOPPED,
        f"the device's own stop failed ({error_text(error)}; {known}), so nothing more is written to it and its own "
        "watchdog stops it",
    )
