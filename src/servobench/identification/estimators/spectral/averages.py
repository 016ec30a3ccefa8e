"""Averages of points over several stretches, and their scatter beyond noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.identification.estimators.spectral.path import Complex

_SAME = 1e-9  # of a frequency: two that are nearer are one
_ALIKE = 1e-3  # of an input's line: realisations that differ less are repetitions
_POOL = 30  # degrees of freedom that a scatter is taken over


@dataclass(frozen=True, kw_only=True, eq=False)
class Column:
    """Points (F,) with the fields of `FrequencyResponse`, and the `input` (F,) at their lines.

    `omega`, `response`, `sd`, `noise_sd`, `distortion_sd`, `coherence` and `resolution` are described there."""

    omega: Array
    response: Complex
    sd: Array
    noise_sd: Array
    distortion_sd: Array
    coherence: Array
    resolution: Array
    input: Complex

    @classmethod
    def none(cls) -> Column:
        """No points."""
        empty = np.empty(0)
        return cls(
            omega=empty, response=empty.astype(complex), sd=empty, noise_sd=empty, distortion_sd=empty,
            coherence=empty, resolution=empty, input=empty.astype(complex),
        )  # fmt: skip


def average(parts: Sequence[Column]) -> Column:
    """Return one point for each frequency, ascending: the mean, each weighted by the inverse of its noise's variance.

    Where the scatter between realisations is larger than noise explains, pooled over neighbouring frequencies, the excess is
    distortion, and `sd` is that of the mean with it.
    """
    values = {
        field.name: np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(Column)
    }
    order = np.argsort(values["omega"], kind="stable")
    every = Column(**{name: column[order] for name, column in values.items()})
    new = np.diff(every.omega, prepend=-np.inf) > _SAME * every.omega
    group = np.cumsum(new) - 1
    if new.all():
        return every
    weight = every.noise_sd**-2.0
    total = np.bincount(group, weight)

    def mean(x: Array) -> Array:
        return np.asarray(np.bincount(group, weight * x) / total, dtype=np.float64)

    response = mean(every.response.real) + 1j * mean(every.response.imag)
    noise_sd = np.asarray(total**-0.5, dtype=np.float64)
    ratio, known = _scatter(every, response[group], weight, group)
    each = np.sqrt(np.bincount(group) / total)  # the noise of one realisation
    more = np.asarray(np.sqrt(np.where(known, np.maximum(ratio, 1.0), 1.0)), dtype=np.float64)
    return Column(
        omega=every.omega[new],
        response=response,
        sd=noise_sd * more,
        noise_sd=noise_sd,
        distortion_sd=np.where(known, each * np.sqrt(np.maximum(ratio - 1.0, 0.0)), np.nan),
        coherence=mean(every.coherence),
        resolution=mean(every.resolution),
        input=every.input[new],
    )


def _scatter(
    every: Column, mean: Complex, weight: Array, group: NDArray[np.int64]
) -> tuple[Array, NDArray[np.bool_]]:
    """The scatter (F,) about the mean over what noise explains, and where it is known: where realisations differ."""
    power = np.bincount(group, 0.5 * weight * np.abs(every.response - mean) ** 2)
    freedom = np.bincount(group) - 1.0
    first = every.input[np.unique(group, return_index=True)[1]][group]
    differs = np.bincount(group, np.abs(every.input - first) > _ALIKE * np.abs(first)) > 0
    power, freedom = np.where(differs, power, 0.0), np.where(differs, freedom, 0.0)
    sums = np.concatenate([[0.0], np.cumsum(power)]), np.concatenate([[0.0], np.cumsum(freedom)])
    ratio = np.ones(len(power))
    for n in np.flatnonzero(differs):
        low, high = int(n), int(n) + 1
        while sums[1][high] - sums[1][low] < _POOL and (low > 0 or high < len(power)):
            low, high = max(low - 1, 0), min(high + 1, len(power))
        ratio[n] = (sums[0][high] - sums[0][low]) / (sums[1][high] - sums[1][low])
    return ratio, differs
