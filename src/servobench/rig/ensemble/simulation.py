"""Simulate the motors of an ensemble: the experiment's voltage or reference for all, threads over blocks of motors."""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import UsageError
from servobench.core.processors import processors
from servobench.rig.devices.twin import Twin, TwinSettings
from servobench.rig.ensemble.lanes import LANES
from servobench.rig.ensemble.motors import Motors
from servobench.rig.experiment import Experiment
from servobench.systems.control.base import CONTROLLERS
from servobench.systems.control.lead import Lead
from servobench.systems.control.open_loop import OpenLoop
from servobench.systems.control.pid import Pid
from servobench.systems.control.state_feedback import StateFeedback
from servobench.systems.signals.step import Step

if TYPE_CHECKING:
    from servobench.rig.ensemble.kernels import Keys

LAWS = (OpenLoop, Pid, Lead, StateFeedback)
"""The control laws that an ensemble can have, in the order of their numbers in the kernels."""
BAND = 0.02
"""Half of the band around the end of a step; the settling time is when a response stays within it."""
MOST_TICKS = 10_000_000
"""The longest experiment of an ensemble."""
_FARTHEST = 2.0**30  # counts: half of what the kernels' numbers of 32 bits hold
_SHOCKS = 10.0  # standard deviations, which none of 1e20 normal numbers exceeds
_PIECES = 8  # that a thread's share is cut into, so that they end together and Ctrl-C needn't wait


@dataclass(frozen=True, kw_only=True, eq=False)
class Course:
    """The simulated course of the motors.

    `states` (3, K, n) are current [A], speed [rad/s] and angle [rad] after the first `looks` (K,) ticks. `counts` (n, N) is the
    encoder at each tick, in 16 bits, and `voltages` (n, N) or, the same for all, (N,) [V] what was applied from then on; None
    where they weren't asked for. `overshoot` (n,) and `settling_time` (n,) [s] are those of a step, NaN where there are none.
    """

    looks: Array
    states: Array
    counts: Array | None
    voltages: Array | None
    overshoot: Array
    settling_time: Array


def simulate(
    motors: Motors,
    experiment: Experiment,
    twin: TwinSettings,
    *,
    seed: int,
    looks: Array,
    recorded: bool = False,
    threads: int | None = None,
    offset: int = 0,
    progress: Callable[[float], object] = lambda _: None,
) -> Course:
    """Let all motors carry an experiment out, up to the last of the `looks` (K,), which count ticks and rise.

    `offset` is the number of the first motor in its ensemble: with `seed` it says which random torque each has. With `recorded`
    counts and voltages are kept. The course doesn't depend on `threads`. Raises `UsageError` for an experiment or a motor that
    can't be simulated so.
    """
    check_can_be_simulated(experiment, twin)
    ticks = int(looks[-1])
    counts_per_rev = twin.counts_per_rev or twin.data_sheet.counts_per_rev
    c = motors.coefficients(experiment.sample_time, twin.torque_noise, counts_per_rev)
    _check_numbers(motors, c, ticks, experiment.sample_time, twin)
    references = values_of(experiment, ticks)
    n, padded = len(motors), c.shape[1]
    room = _Room(
        looks=np.ascontiguousarray(looks, dtype=np.int64),
        states=np.empty((3, len(looks), padded)),
        counts=np.empty((padded // LANES, ticks, LANES), dtype=np.int16) if recorded else None,
        keys=_keys(seed, offset, padded) if twin.torque_noise else None,
        figures=np.full((2, padded), np.nan),
    )
    voltages: Array | None = None
    if isinstance(experiment.controller, OpenLoop):
        within = _within_limits(references, experiment)
        work = _open_loop_work(c, within, twin, room)
        voltages = _amplifier_output(within, motors.parameters["amplifier_limit"]) if recorded else None
    else:
        voltages = np.empty((padded, ticks)) if recorded else None
        work = _closed_loop_work(c, references, experiment, twin, voltages, room)
        voltages = voltages if voltages is None else voltages[:n]
    _share_out(work, padded // LANES, threads, progress)
    overshoot, settling_time = _step_figures(room.figures[:, :n], ticks, experiment)
    return Course(
        looks=room.looks,
        states=room.states[:, :, :n],
        counts=None if room.counts is None else _in_rows(room.counts)[:n],
        voltages=voltages,
        overshoot=overshoot,
        settling_time=settling_time,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Room:
    """The arrays that the kernels fill for M motors, and the keys of their random torques; laid out as `kernels` says."""

    looks: Array
    states: Array
    counts: Array | None
    keys: Keys | None
    figures: Array


def _open_loop_work(c: Array, voltages: Array, twin: TwinSettings, room: _Room) -> Callable[[int, int], None]:
    """Return a function that simulates blocks of motors under the same voltages (N,)."""
    from servobench.rig.ensemble import kernels as at

    dead_band = _dead_band(twin)
    c[at.LIMIT] = np.maximum(c[at.LIMIT] - dead_band, 0.0)
    net = voltages - np.clip(voltages, -dead_band, dead_band)

    def work(first: int, last: int) -> None:
        at.drive(c, net, room.looks, room.states, room.counts, room.keys, twin.start_angle, first, last)

    return work


def _closed_loop_work(
    c: Array,
    references: Array,
    experiment: Experiment,
    twin: TwinSettings,
    voltages: Array | None,
    room: _Room,
) -> Callable[[int, int], None]:
    """Return a function that simulates blocks of motors under the experiment's controller, each with a state of its own."""
    from servobench.rig.ensemble import kernels as at

    info = Twin(twin).info.with_limit(experiment.limits.voltage)
    law = LAWS.index(type(experiment.controller))
    running, p = experiment.controller.start(experiment.sample_time, info), _loop(experiment, twin)

    def work(first: int, last: int) -> None:
        at.loops(
            c, p, law, running.x, running.p, references, room.looks, room.states, room.counts, voltages, room.keys,
            room.figures, twin.start_angle, first, last,
        )  # fmt: skip

    return work


def _amplifier_output(voltages: Array, limits: Array) -> Array:
    """The output of amplifiers with limits (n,): (N,) if all have the same limit, else (n, N)."""
    own = limits[:, None] if np.ptp(limits) else limits[0]
    return np.asarray(np.clip(voltages, -own, own))


def _step_figures(figures: Array, ticks: int, experiment: Experiment) -> tuple[Array, Array]:
    """Overshoot and settling time (n,), NaN where the experiment is no step in a loop, or a response doesn't settle."""
    from servobench.rig.ensemble import kernels as at

    peak, settled = figures[at.PEAK], figures[at.SETTLED]
    left = ticks * experiment.sample_time - _step_at(experiment)
    signal = experiment.signal
    if not (isinstance(signal, Step) and signal.final != signal.initial and left > 0):
        return np.full_like(peak, np.nan), np.full_like(peak, np.nan)
    never = settled > left - 1.5 * experiment.sample_time
    return np.maximum(peak - 1.0, 0.0), np.where(never, np.nan, settled)


def _keys(seed: int, offset: int, count: int) -> Keys:
    """The keys of so many motors from the one with the number `offset` on."""
    from servobench.rig.ensemble import kernels as at

    keys = np.empty(offset + count, dtype=np.uint64)
    at.keys_of(np.uint64(seed), keys)
    return keys[offset:].copy()


def _dead_band(twin: TwinSettings) -> float:
    return twin.data_sheet.dead_band if twin.dead_band is None else twin.dead_band


def check_can_be_simulated(experiment: Experiment, twin: TwinSettings) -> None:
    """Raise `UsageError` for an experiment or settings of a twin that an ensemble doesn't have."""
    if type(experiment.controller) not in LAWS:
        known = ", ".join(CONTROLLERS.name_of(law) for law in LAWS)
        name = type(experiment.controller).__name__
        raise UsageError(f"ensemble: the controller {name} isn't compiled; expected one of {known}")
    ticks = experiment.samples
    if ticks is None or ticks > MOST_TICKS:
        length = "endless" if ticks is None else f"{ticks} ticks long"
        raise UsageError(
            f"ensemble: the experiment is {length}; expected a duration of at most {MOST_TICKS} ticks"
        )
    for name, plain in (("delay", 0.0), ("solver", "exact"), ("watchdog", None)):
        value = getattr(twin, name)
        if value != plain:
            raise UsageError(
                f"ensemble: the twin's {name} is {value}, which an ensemble doesn't simulate; leave it out"
            )
    if experiment.device.faults:
        raise UsageError(
            "ensemble: the experiment injects faults, which an ensemble doesn't; leave [[device.faults]] out"
        )


def values_of(experiment: Experiment, ticks: int) -> Array:
    """Return the signal (ticks,) at each tick; raises `UsageError` where a value isn't finite or the shape is another."""
    t = np.arange(ticks, dtype=np.float64) * experiment.sample_time
    values = np.ascontiguousarray(experiment.signal(t), dtype=np.float64)
    if values.shape != t.shape or not np.isfinite(values).all():
        raise UsageError(
            f"ensemble: the signal {experiment.signal!r} gives values of shape {values.shape} that aren't all finite; expected "
            f"finite ones of shape {t.shape}"
        )
    return values


def _within_limits(values: Array, experiment: Experiment) -> Array:
    """The voltages that a guard lets through (N,)."""
    limits, h = experiment.limits, experiment.sample_time
    clipped = np.clip(values, -limits.voltage, limits.voltage)
    if limits.slew is None:
        return np.asarray(clipped)
    before, most = limits.start_voltage(h), limits.slew * h
    for tick, value in enumerate(clipped.tolist()):
        clipped[tick] = before = min(max(value, before - most), before + most)
    return np.asarray(clipped)


def _loop(experiment: Experiment, twin: TwinSettings) -> Array:
    """The numbers of the loop around a motor."""
    from servobench.rig.ensemble import kernels as at

    limits, signal = experiment.limits, experiment.signal
    bits = twin.counter_bits or twin.data_sheet.counter_bits
    p = np.zeros(11)
    p[at.TICK], p[at.LARGEST] = experiment.sample_time, limits.voltage
    p[at.SLEW] = math.inf if limits.slew is None else limits.slew
    p[at.DEAD_BAND], p[at.HALF_RANGE] = _dead_band(twin), 1 << (bits - 1)
    p[at.BEGUN], p[at.BAND] = limits.start_voltage(experiment.sample_time), BAND
    p[at.STEP_AT], p[at.INITIAL], p[at.FINAL] = _step_at(experiment), 0.0, 1.0
    if isinstance(signal, Step) and signal.final != signal.initial:
        p[at.INITIAL], p[at.FINAL] = signal.initial, signal.final
    p[at.FOLLOWS_SPEED] = experiment.controller.reference_unit == "rad/s"
    return p


def _step_at(experiment: Experiment) -> float:
    return float(experiment.signal.start) if isinstance(experiment.signal, Step) else 0.0


def _check_numbers(motors: Motors, c: Array, ticks: int, sample_time: float, twin: TwinSettings) -> None:
    """Raise `UsageError` where the kernels would meet a value that isn't finite, or a count beyond their range."""
    from servobench.rig.ensemble import kernels as at

    if not np.isfinite(c).all():
        number = int(np.flatnonzero(~np.isfinite(c).all(axis=0))[0])
        raise UsageError(
            f"ensemble: motor {number} ({motors.one(min(number, len(motors) - 1))}) has no finite solution over a tick; expected "
            "parameters of a motor"
        )
    driven = float((motors.gain * motors.parameters["amplifier_limit"]).max())
    # Random shocks add up to a few times √ticks of one, less what fades.
    shaken = _SHOCKS * float(c[at.SHOCK].max()) * math.sqrt(ticks)
    speed, duration = driven + shaken, ticks * sample_time
    counts = (abs(twin.start_angle) + 2 * speed * duration) * float(c[at.SCALE].max())
    if not counts < _FARTHEST:
        raise UsageError(
            f"ensemble: at up to {speed:.3g} rad/s for {duration:.3g} s the encoder may count {counts:.3g}; expected fewer than "
            f"{_FARTHEST:.3g}: use a shorter duration, or an encoder with fewer counts"
        )


def _share_out(
    work: Callable[[int, int], None], blocks: int, threads: int | None, progress: Callable[[float], object]
) -> None:
    """Do all blocks in pieces, each in one of the threads."""
    count = min(threads or processors(), blocks)
    edges = np.linspace(0, blocks, min(count * _PIECES, blocks) + 1).astype(int).tolist()
    pieces = list(pairwise(edges))
    if count == 1:
        for first, last in pieces:
            work(first, last)
            progress(last / blocks)
        return
    with ThreadPoolExecutor(count, thread_name_prefix="servobench ensemble") as pool:
        futures = [pool.submit(work, first, last) for first, last in pieces]
        try:
            for (_, last), future in zip(pieces, futures, strict=True):
                future.result()
                progress(last / blocks)
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise


def _in_rows(counts: Array) -> Array:
    """Counts (M/16, N, 16) as a row for each motor (M, N)."""
    return np.ascontiguousarray(counts.transpose(0, 2, 1)).reshape(-1, counts.shape[1])
