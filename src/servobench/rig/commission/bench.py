"""The bench that is commissioned: it runs what a check asks for, and lets no voltage out before it was earned."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Protocol, TypeAlias

from servobench.core.channels import DeviceInfo
from servobench.core.errors import UsageError
from servobench.core.finding import Finding, Severity
from servobench.core.rounding import plain
from servobench.recordings.recording import Recording, Stopped
from servobench.rig.commission.check_run import CheckRun
from servobench.rig.commission.checks.base import Outcome, State, as_sentence
from servobench.rig.devices.base import Device
from servobench.rig.experiment import Experiment
from servobench.rig.experiment.experiment import DeviceChoice
from servobench.rig.experiment.limits import Limits
from servobench.rig.loop.run import Look
from servobench.rig.lost_device import DeviceLost

PULSE_PART, PULSE_TIME = 0.4, 0.1
"""Before a stop was seen a pulse has this part of the range at most, and lasts so long [s]."""
SPIN = 3.0
"""Before the watchdog was tried, the motor gets at most so many times the voltage that moved it."""
SPAN = 10.0  # V; the range of a device that doesn't say its own
LEAD, TAIL = 0.2, 1.5  # s at zero volts before a run's first voltage, and the least after its last
REST = 0.2  # s; the end of a run, in which the shaft has to be at rest
QUIET = 2.0  # counts; an encoder between two lines may flicker by one either way
LONGEST_TAIL = 10.0  # s
MONITORS = frozenset({"stall", "plausibility", "possible_speed", "current", "speed", "travel"})
"""The limits that a check may change: they end runs, and put nothing out."""
COAST = 8.0  # s; how long a heavy shaft may coast once 0 V were seen to stop it

Runner: TypeAlias = Callable[[Experiment, str, Look | None], Recording]
"""Carries an experiment out and records it under a name."""


class Person(Protocol):
    """Somebody beside the bench who turns the shaft by hand."""

    turns: float
    """The number of turns."""

    def begin(self) -> tuple[float, Look | None]:
        """Ask for the turns; return the longest time that they may take [s], and what sees that they are done."""
        ...


class CheckEnded(Exception):
    """A run that ended a check before its time: what happened, what to do, and the state that the check is in.

    `halts` says that nothing may be driven any more, `interrupted` that somebody asked for the end.
    """

    def __init__(
        self,
        sentence: str,
        remedy: str,
        state: State = "failed",
        *,
        halts: bool = False,
        interrupted: bool = False,
    ) -> None:
        super().__init__(sentence)
        self.sentence = sentence
        self.remedy = remedy
        self.state: State = state
        self.halts = halts
        self.interrupted = interrupted


class Interlock(Exception):
    """A check asked for a voltage that isn't earned yet: a mistake in the check; the device wasn't opened."""


class Bench:
    """A device that is commissioned, with what is known of it so far.

    `run` carries the experiments out, on the device that they name. No voltage beyond `limit` [V] is requested, nor beyond the
    device's own range. `person` is None where nobody can turn the shaft. With `until_wrap` the counter is turned until it wraps.
    Raises `UsageError` for a device that nothing drives, and a limit that isn't above 0 V.
    """

    def __init__(
        self,
        device: Device,
        choice: DeviceChoice,
        run: Runner,
        *,
        limit: float | None = None,
        sample_time: float = 0.002,
        person: Person | None = None,
        until_wrap: bool = False,
        seed: int | None = 0,
    ) -> None:
        self.info: DeviceInfo = device.info
        if not getattr(device, "drives", True):
            raise UsageError(
                f"{self.info.name}: nothing can drive it, so there is nothing to commission; give a device that turns a motor"
            )
        channel = self.info.channel("voltage")
        ends = [abs(end) for end in (channel.minimum, channel.maximum) if end] if channel else []
        own = min(ends) if ends else SPAN
        if limit is not None and not 0 < limit < float("inf"):
            raise UsageError(f"the voltage limit is {limit:g} V; expected one above 0 V, up to {own:g} V")
        self.limit = own if limit is None else min(limit, own)
        self.own_watchdog: float | None = getattr(device, "own_watchdog", None)
        self.own_stall = hasattr(getattr(device, "settings", None), "stall_voltage")
        self.sample_time = sample_time
        self.person = person
        self.until_wrap = until_wrap
        self.recordings: dict[str, Recording] = {}
        """All runs so far by their names, in their order."""
        self.outcomes: dict[str, Outcome] = {}
        """The outcomes of the checks so far."""
        self._choice, self._carry_out, self._seed = choice, run, seed
        self._begun: list[str] = []

    # What is known

    def value_of(self, name: str, otherwise: float = float("nan")) -> float:
        """Return what a check has learned under that name, in SI units or counts."""
        for outcome in self.outcomes.values():
            if name in outcome.learned:
                return outcome.learned[name]
        return otherwise

    def is_settled(self, check: str) -> bool:
        """Whether a check came out so that others can build on it: it was carried out, and didn't fail."""
        outcome = self.outcomes.get(check)
        return outcome is not None and outcome.carried_out and outcome.state != "failed"

    @property
    def allowed(self) -> float:
        """The largest voltage that may be put out by now [V]."""
        if not self.is_settled("rest"):
            return 0.0
        if not self.is_settled("stop"):
            return PULSE_PART * self.limit
        return self.limit if self.is_settled("watchdog") else self.spin_voltage

    @property
    def spin_voltage(self) -> float:
        """A few times the voltage that moved the shaft: it turns slowly, but surely [V]."""
        return min(SPIN * self.value_of("moving_voltage"), PULSE_PART * self.limit)

    @property
    def speed_unit(self) -> tuple[float, str]:
        """The divisor of a speed in counts/s, and its unit then: rad/s where the counts of a turn are known."""
        channel = self.info.channel("counts")
        per_rev = channel.counts_per_rev if channel else None
        return (per_rev / 6.283185307179586, "rad/s") if per_rev else (1.0, "counts/s")

    # What is done

    def begin(self, check: str) -> None:
        """Note which check the runs that follow belong to."""
        self._check = check
        self._begun = []

    def run_names(self) -> tuple[str, ...]:
        """Return the names of the runs of the current check."""
        return tuple(self._begun)

    def wait(self, duration: float, look: Look | None = None, *, may_end: bool = False) -> CheckRun:
        """Record at zero volts for that time [s], or until `look` sees the end; with `may_end` the guard may end it."""
        return self._run(self._experiment(_still(), duration), look=look, may_end=may_end)

    def drive(
        self,
        *segments: tuple[float, float],
        faults: tuple[Mapping[str, Any], ...] = (),
        limits: Mapping[str, Any] | None = None,
        settings: Mapping[str, Any] | None = None,
        tail: float | None = None,
        may_end: bool = False,
        may_lose: bool = False,
    ) -> CheckRun:
        """Put voltages [V] out, each for a time [s], with zero volts before and after, and return what was seen.

        `faults` are injected; `limits` and `settings` of the device are those of this run alone. With `may_end` the guard or the
        device may end it, with `may_lose` the device may stop answering. Raises `CheckEnded` where the run is cut short, or the
        shaft doesn't come to rest.
        """
        self._check_interlock(segments, limits or {})
        tail = self.tail if tail is None else tail
        parts = [(0.0, LEAD), *segments, *([(0.0, tail)] if tail else [])]
        signal = {
            "type": "sequence",
            "segments": [
                {"duration": duration, "signal": {"type": "constant", "value": voltage}}
                for voltage, duration in parts
            ],
        }
        experiment = self._experiment(signal, sum(duration for _, duration in parts), limits)
        choice = experiment.device
        if faults:
            choice = choice.model_copy(update={"faults": (*choice.faults, *faults)})
        if settings:
            choice = choice.model_copy(update={"settings": {**choice.settings, **settings}})
        experiment = experiment.model_copy(update={"device": choice})
        run = self._run(experiment, may_end=may_end, may_lose=may_lose)
        if tail and run.recording.stopped.reason == "finished":
            self._check_rest(run)
        return run

    def check_end(self, run: CheckRun) -> None:
        """Raise `CheckEnded` where the guard or the device ended a run; where the computer was late, nothing is known."""
        stopped = run.recording.stopped
        if stopped.reason != "fault":
            return
        sentence = as_sentence(f"the run was cut short: {stopped.sentence}")
        if any(map(_is_lateness, run.recording.findings)):
            remedy = "Close what keeps the computer busy, and run it again."
            raise CheckEnded(sentence, remedy, "unknown")
        raise CheckEnded(sentence, "See to that first, then run it again.")

    @property
    def tail(self) -> float:
        """The time at zero volts after a run's last voltage [s]: what the shaft needs to come to rest, with plenty to spare."""
        return min(max(TAIL, 4 * self.value_of("rest_time", 0.0) + 2 * REST), LONGEST_TAIL)

    @property
    def quiet(self) -> float:
        """The counts that a shaft at rest may seem to move by."""
        return QUIET + self.value_of("noise", 0.0)

    def _check_interlock(self, segments: Sequence[tuple[float, float]], limits: Mapping[str, Any]) -> None:
        # Asked this way round, as NaN isn't beyond any limit.
        if not all(abs(voltage) <= self.allowed * (1 + 1e-9) for voltage, _ in segments):
            voltages = ", ".join(f"{voltage:g} V" for voltage, _ in segments)
            raise Interlock(f"{self._check}: {self.allowed:g} V are allowed by now; it asked for {voltages}")
        driven = sum(duration for voltage, duration in segments if voltage)
        if not (self.is_settled("stop") or driven <= PULSE_TIME * (1 + 1e-9)):
            raise Interlock(f"{self._check}: {driven:g} s of a voltage were asked for before a stop was seen")
        if not MONITORS.issuperset(limits):
            raise Interlock(f"{self._check}: limits that no monitor has, {', '.join(limits)}, aren't allowed")

    def _experiment(
        self, signal: Mapping[str, Any], duration: float, limits: Mapping[str, Any] | None = None
    ) -> Experiment:
        return Experiment.model_validate(
            {
                "name": f"commission: {self._check}",
                "signal": signal,
                "duration": duration,
                "sample_time": self.sample_time,
                "limits": Limits.model_validate({"voltage": self.limit, **(limits or {})}),
                "device": self._choice,
                "seed": self._seed,
            }
        )

    def _run(
        self,
        experiment: Experiment,
        *,
        look: Look | None = None,
        may_end: bool = False,
        may_lose: bool = False,
    ) -> CheckRun:
        again = len(self._begun) + 1
        name = (
            f"{len(self.outcomes) + 1:02d}-{self._check.replace('_', '-')}{f'-{again}' if again > 1 else ''}"
        )
        try:
            recording = replace(self._carry_out(experiment, name, look), name=name)
        except DeviceLost as error:
            lost = Stopped(reason="device_lost", sentence=str(error))
            recording = replace(error.recording, name=name, stopped=lost)
        self._begun.append(name)
        self.recordings[name] = recording
        if recording.info is not None and len(self.recordings) == 1:
            self.info = (
                recording.info
            )  # only now it knows its firmware; later runs may have settings of their own
        stopped = recording.stopped
        dangers = [each.sentence for each in recording.findings if each.severity is Severity.DANGER]
        if dangers:
            raise CheckEnded(" ".join(dangers), "Cut the supply.", halts=True)
        if stopped.reason == "interrupted":
            raise CheckEnded(
                as_sentence(f"it was {stopped.sentence}"),
                "Run it again.",
                "unknown",
                halts=True,
                interrupted=True,
            )
        if stopped.reason in ("device_lost", "error") and not may_lose:
            raise CheckEnded(as_sentence(stopped.sentence), "Look at the supply and the cable.", halts=True)
        run = CheckRun.of(recording)
        if not may_end:
            self.check_end(run)
        return run

    def _check_rest(self, run: CheckRun) -> None:
        moved = run.range(run.duration - REST, float("inf"))
        if moved > self.quiet and self.is_settled("stop"):
            coasting = self.wait(COAST)
            moved = coasting.range(coasting.duration - REST, float("inf"))
        if moved > self.quiet:
            raise CheckEnded(
                f"The shaft still moved by {plain(moved)} counts within {REST:g} s at the end, although 0 V were put out.",
                "Cut the supply. Find what still drives the motor before you go on.",
                halts=True,
            )


def _is_lateness(finding: Finding) -> bool:
    """Whether a finding says that the computer was too late: the guard's or the device's watchdog, or many missed samples."""
    many = finding.code == "samples-missed" and finding.severity is Severity.WARNING
    return many or finding.code in ("watchdog", "voltages-late")


def _still() -> Mapping[str, Any]:
    return {"type": "constant", "value": 0.0}
