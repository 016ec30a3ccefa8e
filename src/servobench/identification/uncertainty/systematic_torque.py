"""Does the torque that a fit takes for random depend on the motion? Then a part of the model is wrong, and no noise.

A random torque takes up whatever pushes the shaft, friction with another course than the model's as well: the innovations are
white, and nothing else shows that the model is wrong. But they are zero on average wherever the motor is in its motion. So they
are summed over samples of like speed, direction, and sense of the acceleration; if they are white and of variance σ²,

    χ² = Σ (Σ e)² / (n σ²)   over B such groups of n samples

is B ± √(2B) (Pearson 1900). What depends on speed or direction adds up in each group, and χ² grows with the length of the record.
A shaft that friction holds is left out: it shows no torque, and all samples of one rest have the same error of where it stopped.
Likewise the samples that an encoder takes of a slow shaft within one of its steps have one error of rounding: n samples in a row
over k steps count as n²/k, and as n where every sample is a step of its own.
"""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.identification.estimators.base import Fit
from servobench.recordings.measurement.dataset import Dataset

_SPEEDS = np.array([0.02, 0.05, 0.1, 0.2, 0.35, 0.5, 0.7, 0.9])  # of the largest
_FEW = 8  # samples: a group with fewer says nothing
_EVIDENT = (3.5, 5.5)  # standard deviations of χ²: from there on it counts, and counts whole


@runtime_checkable
class Moving(Protocol):
    """A structure that knows how fast the shaft is."""

    def speed(self, theta: Array, data: Dataset) -> Array:
        """Return the shaft's speed (M,) at the samples [position unit/s] for a vector (P + Q,)."""
        ...


def systematic_share(fit: Fit) -> float:
    """Return how evident it is (0 to 1) that a fit's random torque depends on the motion; 0 for a fit without one."""
    structure = fit.model.structure
    if fit.disturbance is None or not isinstance(structure, Moving):
        return 0.0
    speeds = [structure.speed(np.append(fit.model.theta, r.nuisance), r.data) for r in fit.records]
    top = max(float(np.abs(speed).max(initial=0.0)) for speed in speeds)
    if not top > 0:
        return 0.0
    used = [record.valid & (speed != 0.0) for speed, record in zip(speeds, fit.records, strict=True)]
    grouped = [_groups(speed, top) for speed in speeds]
    each = list(zip(grouped, fit.records, used, strict=True))
    groups = np.concatenate([group[use] for group, _, use in each])
    innovations = np.concatenate([record.innovations[use] for _, record, use in each])
    alike = np.concatenate([_samples_alike(group, record.data)[use] for group, record, use in each])
    enough = np.bincount(groups) >= _FEW
    sums, counts = (np.bincount(groups, weights=of)[enough] for of in (innovations, alike))
    variance = float(innovations @ innovations) / max(len(innovations), 1)
    if not len(sums) or not variance > 0:
        return 0.0
    chi2 = float(np.sum(sums**2 / counts)) / variance
    noticed, plain = _EVIDENT
    beyond = (chi2 - len(sums)) / np.sqrt(2.0 * len(sums))
    return float(np.clip((beyond - noticed) / (plain - noticed), 0.0, 1.0))


def _groups(speed: Array, top: float) -> NDArray[np.int64]:
    """The group (M,) of each sample: by the size of its speed, its direction, and whether the shaft speeds up."""
    size = np.searchsorted(_SPEEDS, np.abs(speed) / top, side="right")
    faster = np.gradient(speed) * np.sign(speed) > 0
    return np.asarray(4 * size + 2 * (speed > 0) + faster, dtype=np.int64)


def _samples_alike(groups: NDArray[np.int64], data: Dataset) -> Array:
    """The number of samples (M,) that share each one's error of rounding: those in a row of one group, within a step."""
    if data.quantum is None or data.kind != "position":
        return np.ones(len(groups))
    first = np.flatnonzero(np.diff(groups, prepend=-1) != 0)
    length = np.diff([*first, len(groups)])
    steps = np.abs(data.y[first + length - 1] - data.y[first]) / data.quantum
    return np.maximum(np.repeat(length / (1.0 + steps), length), 1.0)
