"""Telling a device what it can do by itself in a run: the voltages, where they are known, or the law."""

from __future__ import annotations

import numpy as np

from servobench.core.channels import Array
from servobench.rig.devices.guarded import Guarded
from servobench.rig.experiment import Experiment
from servobench.rig.loop.references import BLOCK
from servobench.systems.control.open_loop import OpenLoop


def preload(device: Guarded, experiment: Experiment) -> None:
    """Tell a device that puts voltages out by its own clock those of an experiment in open loop with an end; else none.

    One that computes a law by itself is told that of the experiment.
    """
    if device.takes_voltages_ahead:  # a long run's voltages take memory that other devices needn't spend
        device.preload(_voltages(experiment))
    device.take_law(experiment.controller, experiment.sample_time)


def _voltages(experiment: Experiment) -> Array:
    """The voltages of an experiment (N,) [V], none where they aren't known in advance."""
    samples = experiment.samples
    if samples is None or not isinstance(experiment.controller, OpenLoop):
        return np.empty(0)
    # In the blocks in which the loop evaluates it, so that not even a rounding error differs.
    ticks = np.arange(samples, dtype=np.float64)
    blocks = [
        np.asarray(experiment.signal(ticks[first : first + BLOCK] * experiment.sample_time), dtype=np.float64)
        for first in range(0, samples, BLOCK)
    ]
    voltages = np.concatenate(blocks)
    return voltages if voltages.shape == ticks.shape and np.isfinite(voltages).all() else np.empty(0)
