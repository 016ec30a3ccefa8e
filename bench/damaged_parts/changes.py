"""Ways to damage a recording: each takes a recording and a random generator, and returns what a careless world makes of it."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from servobench.recordings.recording import Recording, Series

Array = NDArray[np.float64]
Change = Callable[[Recording, np.random.Generator], Recording]


def in_place_of(
    recording: Recording, name: str, values: Array | None = None, t: Array | None = None
) -> Recording:
    """Return the recording with other values, or other times, of a channel."""
    old = recording[name]
    new = replace(old, values=old.values if values is None else values, t=old.t if t is None else t)
    return replace(recording, series=tuple(new if each is old else each for each in recording.series))


def both(recording: Recording, rows: NDArray[np.int64]) -> Recording:
    """Return the recording with those rows of input and output only, in that order."""
    for name in (recording.input, recording.output):
        old = recording[str(name)]
        recording = in_place_of(recording, str(name), old.values[rows], np.asarray(old.t)[rows])
    return recording


def output(change: Callable[[Array, np.random.Generator], Array]) -> Change:
    """Return the damage that changes the output's values."""

    def changed(recording: Recording, random: np.random.Generator) -> Recording:
        name = str(recording.output)
        return in_place_of(recording, name, change(recording[name].values.astype(float), random))

    return changed


def input_(change: Callable[[Array, np.random.Generator], Array]) -> Change:
    """Return the damage that changes the input's values."""

    def changed(recording: Recording, random: np.random.Generator) -> Recording:
        name = str(recording.input)
        return in_place_of(recording, name, change(recording[name].values.astype(float), random))

    return changed


def times(change: Callable[[Array, np.random.Generator], Array], *, of: str = "both") -> Change:
    """Return the damage that changes the times of input and output, or of one of them."""

    def changed(recording: Recording, random: np.random.Generator) -> Recording:
        names = {
            "both": (recording.input, recording.output),
            "input": (recording.input,),
            "output": (recording.output,),
        }[of]
        state = random.bit_generator.state
        for name in names:
            random.bit_generator.state = state  # both channels have the same times
            recording = in_place_of(
                recording, str(name), t=change(np.asarray(recording[str(name)].t, dtype=float), random)
            )
        return recording

    return changed


def rows(choose: Callable[[int, np.random.Generator], NDArray[np.int64]]) -> Change:
    """Return the damage that leaves only some rows, or puts them in another order."""

    def changed(recording: Recording, random: np.random.Generator) -> Recording:
        return both(recording, choose(len(recording[str(recording.output)].values), random))

    return changed


def every(n: int) -> Change:
    """Return the damage that keeps every n-th row."""
    return rows(lambda count, random: np.arange(0, count, n))


def without_a_switch(span: int) -> Change:
    """Return the damage that loses `span` rows around a change of the input in the middle of the record."""

    def changed(recording: Recording, random: np.random.Generator) -> Recording:
        u = recording[str(recording.input)].values
        switches = np.flatnonzero(np.diff(u)) + 1
        at = int(switches[len(switches) // 2])
        first = max(at - int(random.integers(1, span)), 1)
        return both(recording, np.concatenate([np.arange(first), np.arange(first + span, len(u))]))

    return changed


def refreshed(hold: int) -> Change:
    """Return the damage of a sensor that gives a new value every `hold` rows only."""
    return output(lambda y, random: y[np.arange(len(y)) // hold * hold])


def spikes(count: int, size: float) -> Change:
    """Return the damage that throws single values `size` off, either way."""

    def change(y: Array, random: np.random.Generator) -> Array:
        at = random.choice(np.arange(20, len(y) - 20), count, replace=False)
        y = y.copy()
        y[at] += size * random.choice([-1.0, 1.0], count)
        return y

    return output(change)


def holes(runs: int, length: int, of: str) -> Change:
    """Return the damage that makes runs of values NaN."""

    def change(x: Array, random: np.random.Generator) -> Array:
        x = x.copy()
        for start in random.choice(np.arange(20, len(x) - 20 - length), runs, replace=False):
            x[start : start + length] = np.nan
        return x

    return output(change) if of == "output" else input_(change)


def mirrored_after(part: float) -> Change:
    """Return the damage of an encoder whose direction turns round after a part of the record."""

    def change(y: Array, random: np.random.Generator) -> Array:
        at = int(part * len(y))
        return np.concatenate([y[:at], 2 * y[at] - y[at:]])

    return output(change)


def negated_after(part: float) -> Change:
    """Return the damage of an input whose sign turns round after a part of the record."""
    return input_(lambda u, random: np.where(np.arange(len(u)) < part * len(u), u, -u))


def stopped_after(part: float) -> Change:
    """Return the damage of a shaft that is held from a part of the record on."""
    return output(lambda y, random: np.where(np.arange(len(y)) < part * len(y), y, y[int(part * len(y))]))


def level(at: float, really: float) -> Change:
    """Return the damage of a label: where the motor got the level `at`, the record says `really`."""
    return input_(lambda u, random: np.where(u == at, really, u))


def shifted(samples: int) -> Change:
    """Return the damage of an output that stands so many rows too early."""

    def changed(recording: Recording, random: np.random.Generator) -> Recording:
        y = recording[str(recording.output)].values
        early = in_place_of(recording, str(recording.output), np.concatenate([y[samples:], y[:samples]]))
        return both(early, np.arange(len(y) - samples))

    return changed


def with_unit(name: str, unit: str, factor: float = 1.0) -> Change:
    """Return the damage of a unit: the values of a channel times a factor, and said to be in `unit`."""

    def changed(recording: Recording, random: np.random.Generator) -> Recording:
        channel = str(recording.input if name == "input" else recording.output)
        old = recording[channel]
        new = Series(
            channel=replace(
                old.channel,
                unit=unit,
                counts_per_rev=None,
                counter_bits=None,
                resolution=None,
                minimum=None,
                maximum=None,
            ),
            values=old.values * factor,
            t=old.t,
        )
        return replace(recording, series=tuple(new if each is old else each for each in recording.series))

    return changed


def with_counts_per_rev(factor: float) -> Change:
    """Return the damage of an encoder that is said to have another number of counts."""

    def changed(recording: Recording, random: np.random.Generator) -> Recording:
        old = recording[str(recording.output)]
        new = replace(
            old, channel=replace(old.channel, counts_per_rev=float(old.channel.counts_per_rev or 0) * factor)
        )
        return replace(recording, series=tuple(new if each is old else each for each in recording.series))

    return changed


def with_input(name: str) -> Change:
    """Return the damage of another channel taken for the input."""
    return lambda recording, random: replace(recording, input=name)


def in_radians(change: Callable[[Array, np.random.Generator], Array]) -> Change:
    """Return the damage of an output that was turned into another form, from the angle in rad."""

    def changed(recording: Recording, random: np.random.Generator) -> Recording:
        old = recording[str(recording.output)]
        angle = (old.values + 0.5) * 2 * np.pi / float(old.channel.counts_per_rev or 2048)
        plain = with_unit("output", "rad")(recording, random)
        return in_place_of(plain, str(recording.output), change(angle, random))

    return changed


def as_speed(noise: float, change: Callable[[Array, np.random.Generator], Array] | None = None) -> Change:
    """Return the damage of a tachometer in place of the encoder, in rad/s, with noise [rad/s], and a change of its values."""

    def changed(recording: Recording, random: np.random.Generator) -> Recording:
        speed = recording["tachometer"].values + noise * random.standard_normal(
            len(recording["tachometer"].values)
        )
        made = in_place_of(recording, "tachometer", speed if change is None else change(speed, random))
        return replace(made, output="tachometer")

    return changed


def nothing(recording: Recording, random: np.random.Generator) -> Recording:
    """The damage that lies in the motor or in the excitation itself."""
    return recording
