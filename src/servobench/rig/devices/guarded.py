"""A guarded device: limits, monitors and a watchdog between the loop and the motor."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from types import TracebackType
from typing import Any, ClassVar, Literal, NoReturn, Self, TypeAlias, cast

import numpy as np

from servobench.core.channels import Array, DeviceInfo, Sample
from servobench.core.errors import DeviceError, ServobenchError, UsageError
from servobench.core.finding import Finding
from servobench.recordings.recording import Stopped
from servobench.rig.devices import handover as at
from servobench.rig.devices.base import (
    Device,
    Following,
    Preloaded,
    Reporting,
    RunEnded,
    value_text,
    voltage_or_nan,
)
from servobench.rig.devices.guard.base import MONITORS, Alarm, Monitor, Motion, Rig
from servobench.rig.devices.guard.faults import (
    Fault,
    faults_found,
    no_voltage,
    not_stopped,
    saturation_finding,
    starvation_alarm,
)
from servobench.rig.devices.guard.lamp import Lamp
from servobench.rig.devices.guard.nominal import nominal_motor
from servobench.rig.devices.guard.rescue import Rescue, first_that_works
from servobench.rig.devices.guard.sample_check import Answers, recordable, unusable
from servobench.rig.devices.guard.stall import StallMonitor
from servobench.rig.devices.guard.watchdog import Watcher
from servobench.rig.devices.handover import Handing, Handover, handover_part
from servobench.rig.experiment.limits import Light, Limits
from servobench.systems.control.base import Controller

WhenFaulted: TypeAlias = Literal["end", "hold"]

_GRACE = 0.01  # s; how long the watcher waits for a write that is under way before it goes between


class Guarded:
    """A device around a device: nothing but a voltage within the limits reaches the inner one, and what goes wrong stops it.

    A voltage beyond `limits.voltage` or faster than `limits.slew` is clipped. `limits.start.voltage` is put out by a run's first
    `read`, directly before its sample: nothing is put out that isn't watched. A value that isn't a finite number, written or
    read, an alarm of one of the monitors (devices/guard, a file each) and a loop that falls silent are faults:
    `limits.terminate.voltage` is put out, at the watchdog `limits.watchdog.voltage`, and the fault is latched until
    `acknowledge`. With `when_faulted="end"` `read` and `write` then raise `RunEnded`, a result, with the sample where that is the
    fault; with "hold" the run goes on at that voltage, whatever is written.

    The watchdog is fed by fresh actuation alone: a `write` that is the first since a new sample. Neither reading nor writing
    again feeds it. That it starved is noticed by the samples' own time at the next read, and, where time goes on meanwhile (a
    device in host or device time), by a thread that cuts the device off; guard/watchdog.py says what that can't catch.

    A device with an attribute `drives` that is False, such as a replay, gets the finite voltages and the clipping only.
    Software is no safety function: a switch in the motor's supply stays necessary.

    `now` tells the time for the watchdog [s]. Raises `UsageError` for limits that the device can't be held to.
    """

    Settings: ClassVar[type[Limits]] = Limits
    _fed: float | None
    _fed_at: float | None
    _writes: int
    _limited: int
    _fresh: bool
    _start_voltage: float
    _elapsed: Callable[[], float] | None
    _index: int
    _driven_light: Light
    _fault_light: Light

    def __init__(
        self,
        device: Device,
        limits: Limits | None = None,
        *,
        when_faulted: WhenFaulted = "end",
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        self.device = device
        self.limits = limits or Limits()
        self._ends = when_faulted == "end"
        self._now = now
        self._drives = bool(getattr(device, "drives", True))
        self._lock = threading.Lock()
        self._fault: Fault | None = None
        self._silent = False
        self._watcher: Watcher | None = None
        self._lamp = Lamp(device)
        self._feedback = False
        self.law: Controller | None = None
        """The law that the device computes by itself, or None."""
        self._prepare(math.nan)

    @property
    def info(self) -> DeviceInfo:
        """The inner device's description."""
        return self.device.info

    @property
    def fault(self) -> Fault | None:
        """The fault that is latched, or None."""
        return self._fault

    @property
    def faults(self) -> tuple[Fault, ...]:
        """All faults of this run, acknowledged or not."""
        return tuple(self._faults)

    @property
    def saturated(self) -> bool:
        """Whether the last write put out another voltage than it was given, beyond half of the output's resolution."""
        return self._saturated

    @property
    def applied(self) -> float:
        """The voltage that was put out last [V]."""
        return self._motion.applied

    @property
    def unwrapped(self) -> int:
        """The last sample's counts as a counter without wraps would show them."""
        return self._motion.unwrapped

    @property
    def time_stalled(self) -> float:
        """For how long the shaft has been stalled [s]; 0 where it isn't, or isn't watched."""
        return next((m.time_stalled for m in self._monitors if isinstance(m, StallMonitor)), 0.0)

    def __enter__(self) -> Self:
        """Connect the inner device."""
        self._reach(self.device.__enter__)
        self._lamp.show(self.limits.start.light)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop the motor and close the connection."""
        self.stop()
        self.device.__exit__(kind, error, trace)

    def start(self, sample_time: float, seed: int | None) -> None:
        """Prepare a run; raises `UsageError` while a fault is latched, and for limits that this device can't be held to."""
        if self._fault is not None:
            raise UsageError(
                f"{self.info.name}: a fault is latched: {self._fault.sentence}; clear it, then acknowledge() it"
            )
        self._unwatch()
        self._prepare(sample_time)
        self._reach(self.device.start, sample_time, seed)
        self._start_voltage = self.limits.start_voltage(sample_time)
        self._lamp.show(self.limits.start.light)
        if self._drives and self._timing != "virtual":
            self._watcher = Watcher(self.look)

    def under_feedback(self, feedback: bool) -> None:
        """Say whether a controller answers to the samples: then the sign of the encoder is watched."""
        self._feedback = self._motion.feedback = feedback

    @property
    def takes_voltages_ahead(self) -> bool:
        """Whether the device can make use of a run's voltages before it begins."""
        return isinstance(self.device, Preloaded)

    def preload(self, voltages: Array) -> None:
        """Tell a device that can make use of it the voltages (N,) [V] of the next run, as far as the limits let them through."""
        limits = self.limits
        if isinstance(self.device, Preloaded):
            as_given = limits.slew is None and not limits.start.voltage
            self.device.preload(np.clip(voltages, -limits.voltage, limits.voltage)[: None if as_given else 0])

    def take_law(self, controller: Controller | None, sample_time: float) -> None:
        """Give a device that computes a law by itself that of the next run, if it is one and the limits let it; else none."""
        limits, self.law = self.limits, None
        if isinstance(self.device, Following):
            as_given = limits.slew is None and not limits.start.voltage
            law = controller if as_given else None
            self.law = law if self.device.take_law(law, sample_time, limits.voltage) else None

    def follow(self, reference: float) -> float:
        """Let the device's law follow a reference [rad or rad/s], and return what it put out with the last sample [V]."""
        return float(self._reach(cast(Following, self.device).follow, reference))

    @property
    def in_blocks(self) -> Handing | None:
        """The guard itself where the device and all that watches it can take part in a block of ticks, else None."""
        able = type(self) is Guarded and handover_part(self.device) is not None
        return self if able and all(isinstance(each, Handing) for each in self._monitors) else None

    @property
    def is_under_way(self) -> bool:
        """Whether nothing is the matter, and the device is driven: the next tick is as ordinary as the last one was."""
        driven = self._fed_at is not None and self._lamp.shown is self._driven_light
        return driven and self._fault is None and not self._start_voltage and self.usable

    def hand_over(self, to: Handover) -> None:
        """Write the device's numbers, the limits, those of the monitors, and the state of all."""
        to.p[at.TIMEOUT], to.p[at.LARGEST], to.p[at.EXACT] = (
            self._timeout_of_samples,
            self._largest,
            self._exact,
        )
        if self._slew is not None:
            to.p[at.SLEW] = self._slew
        to.s[at.FED_AT : at.SATURATED + 1] = (self._fed_at, self._writes, self._limited, self._saturated)
        for each in self._parts():
            each.hand_over(to)

    def take_back(self, block: Handover) -> None:
        """Read the state of the device, of the monitors and of the guard itself."""
        for each in self._parts():
            each.take_back(block)
        self._fed_at, writes, limited, saturated = block.s[at.FED_AT : at.SATURATED + 1].tolist()
        self._writes, self._limited, self._saturated = int(writes), int(limited), bool(saturated)
        self._index, self._fed = int(block.s[at.INDEX]), self._now()

    def _parts(self) -> tuple[Handing, ...]:
        parts = (handover_part(self.device), self._motion, *self._monitors)
        return tuple(each for each in parts if isinstance(each, Handing))

    def set_clock(self, elapsed: Callable[[], float]) -> None:
        """Let faults of this run have the time [s] that the loop keeps, in place of that of the device's samples."""
        self._elapsed = elapsed

    def read(self) -> Sample:
        """Latch and check the inputs; on a fault the output changes before the report. Raises `RunEnded` with "end"."""
        if self._fault is not None and self._ends:
            self._end()
        if self._start_voltage:
            self._put_out_start()
        sample = self._reach(self.device.read)
        if not isinstance(sample, Sample):
            raise DeviceError(
                f"{self.info.name}: its read() returned {value_text(sample)}; expected a Sample"
            )
        motion = self._motion
        self._fresh = self._fresh or sample.index != self._index
        self._index = sample.index
        wrong = unusable(sample) if self._drives else None
        self.usable = wrong is None
        if wrong is not None:
            return self._refuse(sample, wrong)
        motion.take(sample)
        if self._fault is not None:  # on hold, or the watchdog expired while the device was read
            return self._note_sample(sample)
        if self._fed_at is not None and motion.time - self._fed_at > self._timeout_of_samples:
            self._trip(
                starvation_alarm(motion.time - self._fed_at, self._timeout), self.limits.watchdog.voltage
            )
            return sample
        for check in self._checks:
            alarm = check(motion)
            if alarm is not None:
                self._trip(alarm, self.limits.terminate.voltage)
                break
        return sample

    def write(self, voltage: float) -> float:
        """Apply a voltage [V] within the limits, and return what the device puts out; raises `RunEnded` as `read` does."""
        commanded = voltage if type(voltage) is float else voltage_or_nan(voltage)
        if self._fault is not None:
            return self._hold_output(commanded)
        u = commanded
        if not -self._largest <= u <= self._largest:
            if not math.isfinite(u):
                self._trip(no_voltage(voltage), self.limits.terminate.voltage)
                return self._hold_output(commanded)
            u = math.copysign(self._largest, u)
        if self._slew is not None:
            u = self._limit_slew(u)
        if self._fed is None and self._fresh:
            self._fed = self._now()  # the watchdog waits for the first write, too, which may hang
        with self._lock:
            answer = self._reach(self.device.write, u)
        self._writes += 1
        if self._fault is not None:  # the watchdog expired while the device took the voltage
            return self._hold_output(commanded)
        wrong = self._answers.wrong(answer) if self._drives else None
        if wrong is not None:
            self._trip(wrong, self.limits.terminate.voltage)
            return self._hold_output(commanded)
        applied = voltage_or_nan(answer)
        if self._fresh:
            self._fresh = False
            self._fed, self._fed_at = self._now(), self._motion.time
        if self._lamp.shown is not self._driven_light:
            self._lamp.show(self._driven_light)
        self._motion.applied = applied
        self._saturated = not -self._exact <= applied - commanded <= self._exact and self._drives
        if self._saturated:
            self._limited += 1
        return applied

    def stop(self) -> None:
        """Apply the terminate value, then stop the device; never raises.

        If the device's own stop fails, zero volts are written and stop is called again. Where that fails as well nothing
        is written any more, so that the device's own watchdog starves and stops the motor, and a fault is latched. Where one of
        these calls doesn't return, the device's stop and a write of zero volts are tried by other threads meanwhile.
        """
        self._unwatch()
        with self._rescue():
            self._bring_to_rest()

    def _bring_to_rest(self) -> None:
        driven, self._writes = self._writes > 0, 0
        if driven and not self._silent:
            self._attempt(self.limits.terminate.voltage)
        stopped = self._stop_device()
        if stopped is not None and not self._silent:
            refused = self._attempt(0.0)
            stopped = self._stop_device()
            if stopped is not None:
                self._silent = True
                self._add(not_stopped(stopped, zero_volts=refused is None))
        self._motion.applied = 0.0
        self._lamp.show_if_it_can(self.limits.terminate.light if self._fault is None else self._fault_light)

    def _rescue(self) -> AbstractContextManager[object]:
        """The remedies for a call that doesn't return; not needed in virtual time."""
        if not self._drives or self._timing == "virtual":
            return nullcontext()
        return Rescue((self._stop_device, partial(self._attempt, 0.0, locked=True)))

    def refuse(self, alarm: Alarm) -> Stopped | None:
        """Latch a fault of the driver, put the terminate value out, and return why the run is to end; None on "hold"."""
        self._latch(alarm)
        self._attempt(self._fault_voltage)
        self._lamp.show_if_it_can(self._fault_light)
        fault = self._fault
        return Stopped(reason="fault", sentence=fault.sentence) if self._ends and fault is not None else None

    def acknowledge(self) -> None:
        """Take the latched fault away: its reason is seen to, and voltages are put out again."""
        self._fault, self._silent = None, False
        self._fault_light = self.limits.fault_light
        self._fed = self._fed_at = None
        self._watch_afresh()

    def look(self) -> float:
        """Cut the device off where no fresh actuation came in time; return when to look again [s].

        What the watchdog's thread does. It may be called from anywhere at any time.
        """
        fed = self._fed
        if fed is None or self._fault is not None:
            return self._timeout / 4
        silent = self._now() - fed
        if silent <= self._timeout:
            return max(self._timeout - silent, 1e-4)
        # A write that hangs keeps the lock; a motor that runs on is worse than two writes at once.
        locked = self._lock.acquire(timeout=_GRACE)
        try:
            if self._fed == fed:
                self._latch(starvation_alarm(silent, self._timeout), self.limits.watchdog.light)
                write = partial(self._attempt, self.limits.watchdog.voltage, locked=True)
                first_that_works((write, self._stop_device))
        finally:
            if locked:
                self._lock.release()
        return self._timeout / 4

    def findings(self) -> tuple[Finding, ...]:
        """Return what is worth knowing of the run so far: warnings of the monitors, clipping, and faults."""
        findings = [finding for monitor in self._monitors for finding in monitor.findings()]
        if self._limited:
            findings.append(saturation_finding(self._limited))
        if isinstance(self.device, Reporting):
            findings.extend(self.device.findings())
        return (*findings, *faults_found(self._faults, findings))

    def _prepare(self, sample_time: float) -> None:
        """Set everything to the beginning of a run."""
        device, limits = self.info, self.limits
        self._timing = device.timing
        self._timeout = limits.watchdog.timeout
        if self._drives and self._timing != "virtual":
            limits.watchdog.check_sample_time(sample_time)
        # In virtual time no time passes between two ticks, however long they are.
        longest = self._timeout if self._timing != "virtual" else max(self._timeout, 2 * sample_time)
        longest = longest if self._drives else math.inf
        self._timeout_of_samples = longest * (1 + 1e-9)
        self._rig = Rig(
            limits=limits,
            info=device,
            sample_time=sample_time,
            nominal=nominal_motor(limits.plausibility, device),
        )
        self._motion = Motion(self._rig)
        self._motion.feedback = self._feedback
        self._largest, self._slew = limits.voltage, limits.slew
        channel = device.channel("voltage")
        self._exact = max((channel.resolution or 0.0) / 2 if channel else 0.0, 1e-9)
        self._answers = Answers.of(device)
        self._driven_light, self._fault_light = limits.driven_light, limits.fault_light
        self._fresh, self._index = False, -1
        self._fed = self._fed_at = None
        self._writes = self._limited = 0
        self._saturated = False
        self._start_voltage = 0.0
        self._elapsed = None
        self.usable = True
        """Whether the last sample held finite numbers only, so that a controller can make something of it."""
        self._faults: list[Fault] = []
        self._watch_afresh()

    def _reach(self, call: Callable[..., Any], *arguments: object) -> Any:
        """Call the inner device; what its driver raises of a port or a cable is a `DeviceError` with the system's own word."""
        try:
            return call(*arguments)
        except OSError as error:
            if isinstance(error, ServobenchError):
                raise
            why = error.strerror or str(error) or type(error).__name__
            raise DeviceError(f"{self.info.name}: {why}; check its cable, port and supply") from error

    def _put_out_start(self) -> None:
        """Put the start value out once, where the first sample is about to be latched, and let the watchdog wait from there."""
        voltage, self._start_voltage = self._start_voltage, 0.0
        self._fed = self._now()
        with self._lock:
            answer = self.device.write(voltage)
        self._writes += 1
        self._fed = self._now()
        wrong = self._answers.wrong(answer) if self._drives else None
        if wrong is not None:
            self._trip(wrong, self.limits.terminate.voltage)
        else:
            self._motion.applied = voltage_or_nan(answer)

    def _unwatch(self) -> None:
        """End the watchdog: the device isn't driven any more."""
        self._fed = self._fed_at = None
        if self._watcher is not None:
            self._watcher.end()
            self._watcher = None

    def _watch_afresh(self) -> None:
        """Take new monitors, which know nothing of what was before."""
        made = [kind.of(self._rig) for kind in MONITORS] if self._drives else []
        self._monitors: tuple[Monitor, ...] = tuple(monitor for monitor in made if monitor is not None)
        self._checks = tuple(monitor.check for monitor in self._monitors)

    def _limit_slew(self, voltage: float) -> float:
        """The voltage as far as the slew limit lets it go since the last sample."""
        before, most = self._motion.applied, (self._slew or 0.0) * self._motion.dt
        return min(max(voltage, before - most), before + most)

    def _refuse(self, sample: Sample, alarm: Alarm) -> Sample:
        """Trip on a sample that nothing can be made of, and return it as far as it can be recorded."""
        recordable_sample = recordable(sample)
        if self._fault is None:
            self._trip(alarm, self.limits.terminate.voltage, recordable_sample)
        elif self._ends:
            self._attempt_again()
            self._end()
        if recordable_sample is None:
            raise DeviceError(alarm.sentence)
        return recordable_sample

    def _trip(self, alarm: Alarm, voltage: float, sample: Sample | None = None) -> None:
        """Latch a fault, put out a voltage in its place, and with "end" end the run; `sample` is one to be recorded."""
        self._latch(alarm, time=None if sample is None else sample.time)
        failed = self._attempt(voltage)
        if failed is not None:
            self._stop_device()
            if not self._ends or not isinstance(failed, Exception):
                raise failed
        self._lamp.show_if_it_can(self._fault_light)
        if self._ends:
            self._end(sample)

    def _latch(self, alarm: Alarm, light: Light | None = None, time: float | None = None) -> None:
        """Keep a fault, unless there is one already: the first is the cause."""
        if self._fault is None:
            self._add(alarm, light, time)

    def _add(self, alarm: Alarm, light: Light | None = None, time: float | None = None) -> None:
        """Add a fault to those of this run, and latch it unless another one is; `time` [s] is the motion's unless given."""
        by_samples = self._motion.time if time is None else time
        fault = Fault.of(alarm, by_samples if self._elapsed is None else self._elapsed())
        self._faults.append(fault)
        if self._fault is None:
            self._fault_light = light or self.limits.fault_light
            self._fault = fault

    def _end(self, sample: Sample | None = None) -> NoReturn:
        sentence = self._fault.sentence if self._fault else "the motor was stopped"
        raise RunEnded(Stopped(reason="fault", sentence=sentence), sample)

    def _note_sample(self, sample: Sample) -> Sample:
        if self._ends:
            self._attempt_again()
            self._end()
        return sample

    def _hold_output(self, commanded: float) -> float:
        """The voltage while a fault is latched."""
        if self._ends or self._silent:
            self._attempt_again()
            self._end()
        self._lamp.show_if_it_can(self._fault_light)
        with self._lock:
            applied = self._write_checked(self._fault_voltage)
        self._motion.applied = applied
        self._saturated = commanded != applied
        self._limited += self._saturated
        return applied

    @property
    def _fault_voltage(self) -> float:
        starved = self._fault is not None and self._fault.code == "watchdog"
        return self.limits.watchdog.voltage if starved else self.limits.terminate.voltage

    def _attempt_again(self) -> None:
        """Write the fault's voltage once more: a write that was under way may have come after the watchdog's."""
        if not self._silent:
            self._attempt(self._fault_voltage)

    def _attempt(self, voltage: float, *, locked: bool = False) -> BaseException | None:
        """Write a voltage where the motor has to be stopped; return the error where the device doesn't take it."""
        try:
            if locked:
                self._motion.applied = self._write_checked(voltage)
            else:
                with self._lock:
                    self._motion.applied = self._write_checked(voltage)
        except BaseException as error:  # Ctrl-C included: the motor has to be stopped first, by what is left
            return error
        return None

    def _write_checked(self, voltage: float) -> float:
        """Write a voltage where the motor has to be stopped; raises `DeviceError` for an answer that can't be one."""
        answer = self.device.write(voltage)
        wrong = self._answers.wrong(answer) if self._drives else None
        if wrong is not None:
            raise DeviceError(wrong.sentence)
        return voltage_or_nan(answer)

    def _stop_device(self) -> BaseException | None:
        """Tell the device to stop; return the error where it breaks its promise never to raise one."""
        try:
            self.device.stop()
        except BaseException as error:
            return error
        return None
