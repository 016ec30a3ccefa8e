"""The recording of one motor of an ensemble, as a run of it would leave."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import UsageError
from servobench.recordings.recording import Recording, Series, Stopped
from servobench.rig.devices.twin import Twin, TwinSettings
from servobench.rig.ensemble.motors import Motors
from servobench.rig.ensemble.simulation import simulate, values_of
from servobench.rig.experiment import Experiment
from servobench.rig.loop.opening import opening
from servobench.systems.control.open_loop import OpenLoop

_WRAP = 1 << 16


def recording_of(
    parameters: Mapping[str, float], number: int, experiment: Experiment, twin: TwinSettings, seed: int
) -> Recording:
    """Return the recording of the motor with these parameters, number `number` of an ensemble with that seed.

    It has what the voltage was to be, what was applied, the encoder's counts and, of a loop, the reference. Raises `UsageError`
    as `simulate` does.
    """
    one = Motors(
        parameters={name: np.array([value]) for name, value in parameters.items()},
        series=twin.amplifier_resistance,
    )
    ticks = experiment.samples or 0
    course = simulate(
        one, experiment, twin, seed=seed, looks=np.array([ticks]), recorded=True, threads=1, offset=number
    )
    if course.counts is None or course.voltages is None:
        raise UsageError("ensemble: nothing was recorded")
    info = Twin(twin.model_copy(update={"amplifier_limit": parameters["amplifier_limit"]})).info
    opened = opening(experiment, info)
    applied = np.ravel(course.voltages)
    references = values_of(experiment, ticks)
    open_loop = isinstance(experiment.controller, OpenLoop)
    counts = next(each.channel for each in opened.series if each.channel.name == "counts")
    columns = {
        "commanded": references if open_loop else applied,
        "applied": applied,
        "counts": _as_shown(course.counts[0], counts.counter_bits or 16),
        "reference": references,
    }
    t: Array = experiment.sample_time * np.arange(ticks, dtype=np.float64)
    return replace(
        opened,
        name=f"motor {number}",
        series=tuple(
            Series(channel=each.channel, values=columns[each.channel.name], t=t)
            for each in opened.series
            if each.channel.name in columns
        ),
        stopped=Stopped(reason="finished", sentence="the experiment is over"),
    )


def _as_shown(counts: Array, bits: int) -> Array:
    """Counts in 16 bits (N,) as a counter of another width shows them."""
    wide = counts.astype(np.int64)
    steps = (np.diff(wide) + _WRAP // 2) % _WRAP - _WRAP // 2
    travel = wide[0] + np.concatenate([[0], np.cumsum(steps)])
    half = 1 << (bits - 1)
    return np.asarray((travel + half) % (2 * half) - half, dtype=np.float64)
