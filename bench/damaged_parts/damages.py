"""The damages: each mild and severe, with the codes of the findings that are right for it."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from damaged_parts import changes, plants
from damaged_parts.changes import Change
from damaged_parts.recordings import Ours
from servobench.recordings.recording import Recording


@dataclass(frozen=True, kw_only=True)
class Copy:
    """One damaged copy: what was done, to which recordings of ours, and the codes of which one has to be among the findings.

    `nominal` is a data sheet that the result is compared with; `tells` is False where nothing in the data shows the damage.
    """

    damage: str
    severity: str
    words: str
    codes: tuple[str, ...]
    ours: tuple[Ours, ...]
    change: Change = changes.nothing
    nominal: str | None = None
    chain: str = ""
    tells: bool = True

    def made(self, seed: int) -> list[Recording]:
        """Return the damaged recordings of that seed; of several, the last one is damaged."""
        random = np.random.default_rng([seed, 4])
        whole = [ours.made(seed) for ours in self.ours]
        return [*whole[:-1], self.change(whole[-1], random)]


def _pair(
    damage: str,
    codes: str | tuple[str, ...],
    ours: str | Ours,
    mild: tuple[str, Change],
    severe: tuple[str, Change],
    severe_codes: str | tuple[str, ...] = (),
    **more: object,
) -> tuple[Copy, Copy]:
    """The mild and the severe copy of one damage."""
    chosen = ours if isinstance(ours, Ours) else Ours(signal=ours)
    first = (codes,) if isinstance(codes, str) else codes
    second = (severe_codes,) if isinstance(severe_codes, str) else severe_codes or first
    return (
        Copy(
            damage=damage, severity="mild", words=mild[0], codes=first, ours=(chosen,), change=mild[1], **more
        ),  # type: ignore[arg-type]
        Copy(
            damage=damage,
            severity="severe",
            words=severe[0],
            codes=second,
            ours=(chosen,),
            change=severe[1],
            **more,
        ),  # type: ignore[arg-type]
    )


def copies() -> tuple[Copy, ...]:
    """Return all damaged copies."""
    return (*_inputs(), *_times(), *_outputs(), *_units(), *_motors(), *_structures())


def _inputs() -> list[Copy]:
    """Damage to the input."""
    n = changes.nothing
    return [
        Copy(
            damage="input of a single level",
            severity="mild",
            words="one step of 3 V from rest",
            codes=("single-level",),
            ours=(Ours(signal="step from rest"),),
        ),
        Copy(
            damage="input of a single level",
            severity="severe",
            words="2 V throughout",
            codes=("input-constant",),
            ours=(Ours(signal="constant"),),
            change=_already_on,
        ),
        Copy(
            damage="ramp",
            severity="mild",
            words="triangle of ±3 V, 0.1 Hz, its start cut off",
            codes=("input-too-slow",),
            ours=(Ours(signal="triangle 0.1 Hz"),),
            change=_already_on,
        ),
        Copy(
            damage="ramp",
            severity="severe",
            words="0 to 3 V in 10 s",
            codes=("input-too-slow", "parameter-unknown"),
            ours=(Ours(signal="ramp"),),
        ),
        *_pair(
            "input clipped",
            "gain-falls",
            "staircase",
            ("at 2.8 of 3 V", plants.saturated(2.8)),
            ("at 1.5 of 3 V", plants.saturated(1.5)),
        ),
        *_pair(
            "amplifier saturates, slow sine sum",
            "gain-falls",
            "multisine",
            ("at 2.5 of 3 V", plants.saturated(2.5)),
            ("at 1.5 of 3 V", plants.saturated(1.5)),
        ),
        Copy(
            damage="dead zone",
            severity="mild",
            words="0.2 V of 3 V",
            codes=("dead-zone",),
            ours=(Ours(signal="multisine", device=(("dead_band", 0.2),)),),
            change=n,
        ),
        Copy(
            damage="dead zone",
            severity="severe",
            words="0.6 V of 3 V",
            codes=("dead-zone",),
            ours=(Ours(signal="multisine", device=(("dead_band", 0.6),)),),
            change=n,
        ),
        *_pair(
            "sign of the input",
            "sign-flips",
            "PRBS",
            ("turned after 85 %", changes.negated_after(0.85)),
            ("turned after 50 %", changes.negated_after(0.5)),
        ),
        *_pair(
            "a level other than its label",
            "level-disagrees",
            "staircase",
            ("3 V says 2.9", changes.level(3.0, 2.9)),
            ("3 V says 2", changes.level(3.0, 2.2)),
        ),
        *_pair(
            "input is the output",
            "input-is-output",
            "PRBS",
            ("output in volts with noise", _echo(0.01)),
            ("output in volts", _echo(0.0)),
        ),
        *_pair(
            "reference in place of the input",
            "input-settles-at-output",
            Ours(signal="staircase", device=(("tachometer", True),)),
            ("a speed loop's", _loop(0.1)),
            ("a fast one's", _loop(0.02)),
        ),
        *_pair(
            "input unrelated",
            "input-unrelated",
            "PRBS",
            ("another sequence", changes.input_(lambda u, random: np.roll(u, len(u) // 2 + 137))),
            ("noise", changes.input_(lambda u, random: random.standard_normal(len(u)))),
        ),
    ]


def _already_on(recording: Recording, random: np.random.Generator) -> Recording:
    """A record that begins while the input is there already."""
    from dataclasses import replace

    return replace(changes.rows(lambda count, _: np.arange(500, count))(recording, random), input_before=None)


def _loop(lag: float) -> Change:
    """A speed that follows its reference, 20 rad/s for each volt of the record's input, by a loop of that lag [s]."""

    def changed(recording: Recording, random: np.random.Generator) -> Recording:
        u = 20 * recording[str(recording.input)].values
        decay, speed = np.exp(-0.002 / lag), np.empty(len(u))
        now = 0.0
        for k, reference in enumerate(u):
            speed[k] = now
            now = reference + (now - reference) * decay
        told = changes.in_place_of(recording, str(recording.input), u)
        return changes.as_speed(0.3, lambda y, r: speed + 0.3 * r.standard_normal(len(speed)))(told, random)

    return changed


def _coarse(factor: int) -> Change:
    """An encoder with so many times less counts."""

    def changed(recording: Recording, random: np.random.Generator) -> Recording:
        fine = changes.output(lambda y, _: np.floor(y / factor))(recording, random)
        return changes.with_counts_per_rev(1 / factor)(fine, random)

    return changed


def _echo(noise: float) -> Change:
    """The output once more, scaled, in place of the input."""

    def changed(recording: Recording, random: np.random.Generator) -> Recording:
        y = recording[str(recording.output)].values
        scaled = 0.01 * y + noise * random.standard_normal(len(y))
        return changes.in_place_of(recording, str(recording.input), scaled)

    return changed


def _times() -> list[Copy]:
    """Damage to the times."""

    def jitter(share: float) -> Change:
        return changes.times(lambda t, random: t + 0.002 * share * random.random(len(t)))

    def duplicates(share: float) -> Change:
        return changes.rows(
            lambda n, random: np.sort(
                np.concatenate([np.arange(n), random.choice(n, int(share * n), replace=False)])
            )
        )

    def swapped(count: int) -> Change:
        def order(n: int, random: np.random.Generator) -> np.ndarray:
            out = np.arange(n)
            for k in random.choice(np.arange(1, n - 1, 4), count, replace=False):
                out[[k, k + 1]] = out[[k + 1, k]]
            return out

        return changes.rows(order)

    def drifting(share: float) -> Change:
        return changes.times(lambda t, random: t * (1 + share), of="output")

    return [
        *_pair(
            "sampling too slow",
            "sampling-too-slow",
            Ours(signal="PRBS", duration=30.0),
            ("every 0.1 s", changes.every(50)),
            ("every 0.3 s", changes.every(150)),
        ),
        *_pair(
            "duplicate rows", "rows-left-out", "PRBS", ("0.2 %", duplicates(0.002)), ("20 %", duplicates(0.2))
        ),
        *_pair(
            "rows out of order", "rows-left-out", "PRBS", ("2 pairs", swapped(2)), ("100 pairs", swapped(100))
        ),
        *_pair(
            "late samples",
            "time-uneven",
            "PRBS",
            ("up to 0.1 of a sample time", jitter(0.1)),
            ("up to 0.9 of a sample time", jitter(0.9)),
        ),
        *_pair(
            "missing samples",
            "gap-input-unknown",
            "PRBS",
            ("10 rows around a switch", changes.without_a_switch(10)),
            ("400 rows around a switch", changes.without_a_switch(400)),
        ),
        *_pair(
            "missing samples, sines",
            "gap-input-unknown",
            "multisine",
            ("40 rows", changes.without_a_switch(40)),
            ("400 rows", changes.without_a_switch(400)),
        ),
        *_pair("two clocks", "clock-drift", "PRBS", ("0.1 %", drifting(0.001)), ("1 %", drifting(0.01))),
        *_pair(
            "output before its cause",
            "delay-negative",
            "PRBS",
            ("3 samples early", changes.shifted(3)),
            ("50 samples early", changes.shifted(50)),
        ),
        *_pair(
            "stale values",
            "output-stale",
            "PRBS",
            ("new every 3 rows", changes.refreshed(3)),
            ("new every 11 rows", changes.refreshed(11)),
        ),
    ]


def _outputs() -> list[Copy]:
    """Damage to the output."""
    fast = Ours(signal="staircase", device=(("tachometer", True),))
    swing = Ours(signal="square ±2 V")
    return [
        *_pair(
            "encoder resolution",
            ("resolution-coarse",),
            "square ±2 V",
            ("16 counts/rev", _coarse(128)),
            ("4 counts/rev", _coarse(512)),
        ),
        *_pair(
            "few counts moved",
            ("resolution-coarse",),
            Ours(signal="PRBS", duration=1.0),
            ("32 counts/rev", _coarse(64)),
            ("8 counts/rev", _coarse(256)),
        ),
        *_pair(
            "speed with few levels",
            ("resolution-coarse",),
            fast,
            ("steps of 12 rad/s", changes.as_speed(0.0, lambda y, r: 12 * np.rint(y / 12))),
            ("steps of 40 rad/s", changes.as_speed(0.0, lambda y, r: 40 * np.rint(y / 40))),
        ),
        *_pair(
            "speed clipped",
            "output-clipped",
            fast,
            ("at 60 of 70 rad/s", changes.as_speed(0.3, lambda y, r: np.clip(y, -60, 60))),
            ("at 30 of 70 rad/s", changes.as_speed(0.3, lambda y, r: np.clip(y, -30, 30))),
        ),
        *_pair(
            "position clipped",
            "output-clipped",
            swing,
            ("the last 5 % of the range", changes.output(_clip(0.95))),
            ("the upper half", changes.output(_clip(0.5))),
        ),
        *_pair(
            "encoder direction",
            "sign-flips",
            "PRBS",
            ("turned after 85 %", changes.mirrored_after(0.85)),
            ("turned after 50 %", changes.mirrored_after(0.5)),
        ),
        *_pair(
            "angle wraps",
            "angle-wraps",
            "square",
            ("at ±180°", changes.in_radians(lambda y, r: (y + np.pi) % (2 * np.pi) - np.pi)),
            ("at 360°, in deg", _wrapped_degrees),
        ),
        *_pair(
            "counter wraps",
            "angle-wraps",
            "square",
            ("16 bits", _wrapped_counter(16)),
            ("12 bits", _wrapped_counter(12)),
        ),
        *_pair(
            "wheel blocked",
            "output-stops",
            "PRBS",
            ("for the last 15 %", changes.stopped_after(0.85)),
            ("throughout", changes.stopped_after(0.0)),
            "output-still",
        ),
        *_pair(
            "spikes",
            "output-spikes",
            "PRBS",
            ("2 of 40 counts", changes.spikes(2, 40.0)),
            ("30 of 4000 counts", changes.spikes(30, 4000.0)),
        ),
        *_pair(
            "NaN in the output",
            "rows-left-out",
            "PRBS",
            ("one run of 10", changes.holes(1, 10, "output")),
            ("10 runs of 100", changes.holes(10, 100, "output")),
        ),
        *_pair(
            "NaN in the input",
            ("rows-left-out",),
            "PRBS",
            ("one run of 60", changes.holes(1, 60, "input")),
            ("10 runs of 100", changes.holes(10, 100, "input")),
        ),
    ]


def _clip(part: float) -> Callable[[np.ndarray, np.random.Generator], np.ndarray]:
    return lambda y, random: np.minimum(y, y.min() + part * np.ptp(y))


def _wrapped_degrees(recording: Recording, random: np.random.Generator) -> Recording:
    radians = changes.in_radians(lambda y, r: np.degrees(y) % 360)(recording, random)
    return changes.with_unit("output", "deg")(radians, random)


def _wrapped_counter(bits: int) -> Change:
    def changed(recording: Recording, random: np.random.Generator) -> Recording:
        size = 2.0**bits
        # Near the end of its range, as a counter may well be, so that it does wrap.
        start = 0.97 * size
        plain = changes.with_unit("output", "counts")(recording, random)
        return changes.output(lambda y, r: np.mod(y - y[0] + start, size))(plain, random)

    return changed


def _units() -> list[Copy]:
    """Wrong units: noticed if something else is known of the motor, or if the size is absurd."""
    sheet = {"nominal": "qube_servo_2"}
    return [
        *_pair(
            "counts in a turn",
            "factor-off",
            "PRBS",
            ("twice as many", changes.with_counts_per_rev(2.0)),
            ("a quarter", changes.with_counts_per_rev(0.25)),
            **sheet,
        ),
        *_pair(
            "turns for radians",
            "factor-off",
            "PRBS",
            ("rev as rad", changes.in_radians(lambda y, r: y / (2 * np.pi))),
            ("deg as rad", changes.in_radians(lambda y, r: np.degrees(y))),
            **sheet,
        ),
        *_pair(
            "size of the output, no data sheet",
            "size-absurd",
            "PRBS",
            ("deg as rad", changes.in_radians(lambda y, r: np.degrees(y))),
            ("counts as rad", changes.with_unit("output", "rad")),
        ),
        *_pair(
            "size of the input",
            "size-absurd",
            "PRBS",
            ("mV as V", changes.input_(lambda u, r: 1000 * u)),
            ("V as kV", changes.input_(lambda u, r: u / 1000)),
        ),
        *_pair(
            "size of the times",
            "size-absurd",
            "PRBS",
            ("ms as s", changes.times(lambda t, r: 1000 * t)),
            ("µs as s", changes.times(lambda t, r: 1e6 * t)),
        ),
    ]


def _motors() -> list[Copy]:
    """Records that don't belong together."""
    one = Ours(signal="PRBS")
    other = lambda factor: Ours(signal="square ±2 V", device=(("motor_constant", 0.042 * factor),))  # noqa: E731
    return [
        Copy(
            damage="records that disagree",
            severity="mild",
            words="motor constant 8 % larger in one of two",
            codes=("records-disagree",),
            ours=(one, Ours(signal="square ±2 V")),
            change=changes.input_(lambda u, r: 0.92 * u),
        ),
        Copy(
            damage="records that disagree",
            severity="severe",
            words="another motor in one of two",
            codes=("records-disagree",),
            ours=(one, other(2.0)),
        ),
        *_pair(
            "supply droops",
            ("motor-changes",),
            "PRBS",
            ("6 % over the record", _droop(0.06)),
            ("40 % over the record", _droop(0.4)),
        ),
    ]


def _droop(share: float) -> Change:
    def changed(recording: Recording, random: np.random.Generator) -> Recording:
        u = recording[str(recording.input)].values
        return plants.driven(recording, u * (1 - share * np.linspace(0, 1, len(u))))

    return changed


def _structures() -> list[Copy]:
    """Plants that aren't this motor."""
    return [
        *_pair(
            "pendulum",
            # A structure with gravity may well have it; then nothing is wrong, and the weight is told.
            ("gravity-found", "response-oscillates"),
            "PRBS",
            ("0.5 V of weight", plants.pendulum(0.5)),
            ("4 V of weight", plants.pendulum(4.0)),
        ),
        *_pair(
            "hysteresis",
            "hysteresis",
            "multisine",
            ("±0.1 V", plants.hysteresis(0.1)),
            ("±0.6 V", plants.hysteresis(0.6)),
        ),
        *_pair(
            "limit cycle",
            "limit-cycle",
            Ours(signal="PRBS"),
            ("of 0.2 turns", plants.relay(0.2)),
            ("of 0.02 turns", plants.relay(0.02)),
        ),
        *_pair(
            "speed without its chain",
            "chain-unknown",
            Ours(signal="PRBS", device=(("tachometer", True),)),
            ("raw", changes.as_speed(0.5)),
            ("mean over 50 ms", changes.as_speed(0.5, _mean_of(25))),
        ),
    ]


def _mean_of(samples: int) -> Callable[[np.ndarray, np.random.Generator], np.ndarray]:
    return lambda y, random: np.convolve(y, np.full(samples, 1 / samples))[: len(y)]
