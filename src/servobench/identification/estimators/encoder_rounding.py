"""The effect of an encoder's rounding on the parameters, given the model's path of the shaft.

Rounding isn't white. At rest, all samples of the shaft are rounded in the same way, so they give its position once and not a
hundred times; near a reversal, or at a speed in step with the samples, it is almost the same. But given the path x_k of the
shaft, only its place among the counts is unknown, and that is practically random. The error of rounding to steps Q is a
sawtooth of that place, a sum of sines of m = 1, 2, ... periods in a step, each with the variance Q²/(2π²m²), so that

    E[e_k e_l] = Σ Q²/(2π²m²) cos(2πm (x_k - x_l)/Q),   and Q²/12 for k = l

Noise of standard deviation s before the rounding leaves the part e^(-(2πms/Q)²) of each sine correlated between samples, and
turns the rest into white noise (Widrow, Kollár and Liu 1996).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from servobench.core.channels import Array
from servobench.recordings.measurement.dataset import Dataset

SINES = 8  # these have 93 % of Q²/12; the model doesn't know the path to a tenth of a step, as finer ones would need

_BLOCK = 8192  # samples whose sines are held at once


def is_rounded(data: Dataset) -> bool:
    """Return whether a record holds an encoder's positions as they were counted, with a quantum that is known."""
    return bool(data.quantum) and data.kind == "position"


def shares(noise: float = 0.0) -> Array:
    """Return what part of Q² is in each sine of the rounding error (8,): e^(-(2πm)² noise)/(2π²m²); `noise` is s²/Q²."""
    periods = 2 * np.pi * np.arange(1, SINES + 1)
    return np.asarray(np.exp(-(periods**2) * noise) * 2 / periods**2, dtype=np.float64)


def noise_before(residual_sd: float, quantum: float) -> float:
    """Return the variance s²/Q² of the noise before the rounding to steps Q, by the standard deviation of both together."""
    return max((residual_sd / quantum) ** 2 - 1 / 12, 0.0)


def rounding_sines(columns: Array, path: Array, quantum: float, noise: float) -> tuple[Array, float]:
    """Return what the sines of the rounding error make of C'e for columns C (M, P), and the variance of what of it is white.

    The sines' part is S'n with S (16, P) and n standard normal. n belongs to the encoder and not to the record: pieces of one
    recording have it in common, and their S are to be added before they are squared. `path` (M,) is where the shaft was, `noise`
    the variance s²/Q² before the rounding.
    """
    from servobench.identification.estimators import kernels

    powers = shares(noise)
    sines = np.zeros((2 * SINES, columns.shape[1]))
    for start in range(0, len(path), _BLOCK):
        rows = slice(start, start + _BLOCK)
        sines += kernels.harmonics(path[rows] / quantum, SINES) @ columns[rows]
    white = 1 / 12 + noise - float(powers.sum())
    return quantum * np.sqrt(np.repeat(powers, 2))[:, None] * sines, quantum**2 * white


def counts_in_place(
    data: Sequence[Dataset], residuals: Sequence[Array], unknowns: int, times: float = 2.0
) -> bool:
    """Return whether the counts are where the model and the encoder's rounding put them: then nothing else is at work.

    The true position is within half a count of the middle of its own. The prediction's standard deviation is about
    Q √(p / 12 N) for p `unknowns` and N samples, so that about 0.8 of it, over Q, of the counts come out on the wrong side.
    So many `times` over count as chance. Stricter than any test of colour: slow beats of speed and encoder look like
    a wandering shaft, but leave no count in the wrong place.
    """
    wrong, samples = 0, 0
    for record, residual in zip(data, residuals, strict=True):
        if not record.quantum or record.kind != "position" or record.chain.linear:
            return False
        wrong += int(np.count_nonzero(np.abs(residual) > 0.5 * record.quantum))
        samples += len(residual)
    return bool(wrong <= times * 0.8 * samples * np.sqrt(unknowns / (12 * samples)))
