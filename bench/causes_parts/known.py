"""Real recordings whose cause is known, from the README beside each: what they may be told, and what they must be told."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from real_parts.recordings import FOLDER, RealRecording, usable

from causes_parts.told import Told, told
from servobench.recordings.measurement.dataset import Dataset

# What any real motor may have to some degree, so that nobody can call it false: friction's law, cogging, warming, a winding.
_OF_ANY_MOTOR = frozenset(
    {
        "backlash",
        "directions-differ",
        "drag-differs",
        "drag-not-linear",
        "fast-pole",
        "friction-changes",
        "friction-depends-on-speed",
        "friction-grows-with-load",
        "gain-local",
        "motor-changes",
        "ripple",
        "structure-wrong",
    }
)
# What further a motor or its recording has, by its README.
_OWN: Mapping[str, frozenset[str]] = {
    "undcmotor": frozenset({"dead-zone", "gain-falls", "output-clipped"}),
    "ev3": frozenset({"dead-zone", "gain-falls"}),
    "ev3-large": frozenset({"dead-zone", "gain-falls"}),
    "l298": frozenset({"dead-zone", "level-disagrees"}),
    "gkeiel": frozenset({"limit-cycle", "hysteresis", "dead-zone"}),
    "waam": frozenset({"second-pole"}),
    "romi-left": frozenset({"output-spikes"}),
    "romi-right": frozenset({"output-spikes"}),
    "fra233": frozenset({"output-spikes"}),
    "slow": frozenset({"coast-only"}),  # its input is 200 and then 0
    "stuck": frozenset({"output-still"}),
    # The hysteresis is in its README; that the second volt adds 0.85 rad/s and the seventh 0.09 is in the file.
    "hydraulic": frozenset({"hysteresis", "speed-by-direction", "gain-falls", "second-pole"}),
    "saturated": frozenset({"gain-falls", "dead-zone"}),
    "mislabelled": frozenset({"records-disagree"}),
    "pendulum": frozenset({"response-oscillates", "second-pole", "input-is-a-goal", "input-is-reference"}),
}


@dataclass(frozen=True, kw_only=True)
class Known:
    """One case: the recordings that are fitted together, whose they are, and the code that must be among the accusations."""

    name: str
    motor: str
    recordings: tuple[RealRecording, ...]
    must: str = ""

    def data(self) -> list[Dataset]:
        """Return the recordings as identification takes them."""
        return [each.dataset() for each in self.recordings]


@dataclass(frozen=True, kw_only=True)
class Judged:
    """The judgement of a case: its false causes (`false`), whether a cause must be named, and whether it was."""

    told: Told
    false: tuple[str, ...]
    has_cause: bool
    named: bool


def cases() -> tuple[Known, ...]:
    """Return the cases: each usable recording alone, motors of several records, and recordings with something wrong."""
    alone = [Known(name=each.name, motor=each.motor, recordings=(each,)) for each in usable()]
    joint = [
        Known(
            name=f"{motor} together",
            motor=motor,
            recordings=tuple(each for each in usable() if each.motor == motor),
        )
        for motor in ("fra233", "ev3", "qube3", "romi-left", "swerve-left", "swerve-right")
    ]
    return (*alone, *joint, *_with_something_wrong())


def _with_something_wrong() -> list[Known]:
    speeds = {"input": "sig_volt:V", "output": "sig_speed:rad/s"}
    return [
        _one("ev3_duty/data20.csv", "stuck", {"time": "2:s", "input": "1:%", "output": "4:deg"}),
        _one("slow_ticks/motor-direito.csv", "slow", {"time": "1:ms", "input": "5:1", "output": "3:rpm"}),
        _one(
            "hydraulic_valve_motor/MotorRotation.csv",
            "hydraulic",
            {"time": "1:s", "input": "2:V", "output": "3:rad/s"},
            must="speed-by-direction",
        ),
        _one("fra233/2026-02-06_19-57-16_Ramp.mat", "fra233", speeds),
    ]


def _one(file: str, motor: str, roles: Mapping[str, str], must: str = "") -> Known:
    return Known(
        name=file, motor=motor, recordings=(RealRecording(motor=motor, file=file, roles=roles),), must=must
    )


def real_ones(
    show: Callable[[Told], None] = lambda told: None, among: Iterable[Known] | None = None
) -> list[Judged]:
    """Return the judgement of each case; none where the folder of real recordings is absent."""
    if not FOLDER.is_dir():
        return []
    found = []
    for case in cases() if among is None else among:
        one = told(case.name, case.data())
        show(one)
        allowed = _OF_ANY_MOTOR | _OWN.get(case.motor, frozenset())
        found.append(
            Judged(
                told=one,
                false=tuple(code for code in one.codes if code not in allowed),
                has_cause=bool(case.must),
                named=case.must in one.codes,
            )
        )
    return found
