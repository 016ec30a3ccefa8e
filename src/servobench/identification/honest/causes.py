"""The causes of differences between runs: which parameters change together, and with what.

A first-order motor has K = k/(R b + k²), τ = R J/(R b + k²), and Coulomb friction T_c takes u_c = T_c R/k volts. By algebra each
cause moves (ln K, ln τ, ln u_c) in a direction of its own, to first order, for small friction b:

    resistance, as of a winding that warms   (0, 1, 1)        inertia                    (0, 1, 0)
    torque constant, as of a warm magnet     (-1, -2, -1)     Coulomb friction           (0, 0, 1)
    viscous friction                         (-1, -1, 0)      scale of the encoder       (1, 0, -0)
    supply or gain of the amplifier          (1, 0, -1)

S is the scatter between runs less the covariance stated for each run. The share of a direction v in it is v' S v / tr S for |v|
= 1. The axes are scaled so that a parameter counts less if its uncertainty exceeds a tenth of the scatter.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from servobench.core.channels import Array
from servobench.identification.estimators.base import Fit

_AXES = ("gain", "time_constant", "coulomb_voltage")
_EXPLAINED = 0.9  # of the scatter; below that no single cause is named
_AS_GOOD = 0.02  # shares closer than this can't be separated
_STILL = 0.05  # the probability of so little scatter by chance
_DIM = 0.1  # of the scatter's variance: noise of an axis that is as large halves what the axis counts
_KNOWN = 5.0  # standard deviations that a parameter has to be away from zero, for its logarithm
_COPPER = 0.0039  # 1/K, change of copper's resistance


@dataclass(frozen=True, kw_only=True)
class Cause:
    """A possible cause of differing runs: its name, the share of the scatter that it explains, and its change in each run.

    `changes` are relative to the mean of all runs; `sentence` says it in words.
    """

    name: str
    share: float
    changes: tuple[float, ...]
    sentence: str


@dataclass(frozen=True, kw_only=True)
class Trend:
    """A parameter that follows something: what, in which sense (±1, 0 for neither), and the probability of as much by chance."""

    parameter: str
    follows: str
    sense: int
    p: float


_SIGNATURES: Mapping[str, tuple[tuple[float, float, float], str]] = {
    "resistance": (
        (0, 1, 1),
        "the resistance changed: time constant and Coulomb voltage change together, and the gain stays",
    ),
    "inertia": ((0, 1, 0), "the inertia changed: only the time constant changes"),
    "torque constant": (
        (-1, -2, -1),
        "the torque constant changed, as when a magnet warms: the time constant changes twice as much as the gain",
    ),
    "Coulomb friction": ((0, 0, 1), "the friction changed: gain and time constant stay"),
    "viscous friction": ((-1, -1, 0), "the viscous friction changed: gain and time constant change together"),
    "encoder scale": (
        (1, 0, 0),
        "the scale of the encoder changed, or a belt slips: only the gain changes",
    ),
    "supply": (
        (1, 0, -1),
        "the supply or the amplifier's gain changed: gain and Coulomb voltage change in opposite directions",
    ),
}


def causes(fits: Sequence[Fit], different: Collection[str]) -> tuple[Cause, ...]:
    """Return what explains the scatter between fits of one structure, the best first; several that can't be told apart.

    `different` are the parameters that scatter by more than is stated: a cause has to move each of them, and no other parameter
    by so much that it would have to scatter as well. None where no such cause explains nine tenths of the scatter.
    """
    logs, noise = _logarithms(fits)
    scattered = (logs - logs.mean(axis=0)).T @ (logs - logs.mean(axis=0)) / (len(logs) - 1) - noise
    total = float(np.trace(scattered))
    if total <= 0 or np.any(np.diag(noise) <= 0):
        return ()
    weights = 1 / (np.diag(noise) + _DIM * total / len(noise))
    whole = float(weights @ np.diag(scattered))
    candidates = []
    for name, (direction, words) in _SIGNATURES.items():
        v = np.array(direction, dtype=np.float64)[: logs.shape[1]]
        along = weights * v
        if not v.any() or not _fits_all(v, logs, noise, different):
            continue
        share = float(along @ scattered @ along) / (float(along @ v) * whole)
        known_best = v / np.diag(noise)
        changes = (logs - logs.mean(axis=0)) @ known_best / float(known_best @ v)
        candidates.append(
            Cause(name=name, share=min(share, 1.0), changes=tuple(map(float, changes)), sentence=words)
        )
    candidates.sort(key=lambda cause: -cause.share)
    if not candidates or candidates[0].share < _EXPLAINED:
        return ()
    return tuple(cause for cause in candidates if cause.share > candidates[0].share - _AS_GOOD)


def _fits_all(v: Array, logs: Array, noise: Array, different: Collection[str]) -> bool:
    """Whether a cause that moves the axes by v (D,) moves all that differ, and leaves the others as still as they are.

    Its size is what the axis that differs most needs. Of an axis that doesn't differ, a variance s² of n runs is too small for
    what is stated and the cause's part together, σ², where (n - 1) s²/σ² is below the 5 % point of χ² with n - 1 degrees of
    freedom.
    """
    from scipy.stats import chi2

    variance, stated = np.var(logs, axis=0, ddof=1), np.diag(noise)
    differs = np.array([name in different for name in _AXES[: len(v)]])
    if (differs & (v == 0)).any():
        return False
    size = max((variance - stated)[differs] / v[differs] ** 2, default=0.0)
    freedom = len(logs) - 1
    still = freedom * variance >= float(chi2.ppf(_STILL, freedom)) * (stated + size * v**2)
    return bool(still[~differs & (v != 0)].all())


def warming(cause: Cause) -> float:
    """Return the warming of copper [K] that changes its resistance as much as it changed from the first run to the last."""
    return (cause.changes[-1] - cause.changes[0]) / _COPPER


def trends(
    names: Sequence[str], fits: Sequence[Fit], beside: Mapping[str, Sequence[float]]
) -> tuple[Trend, ...]:
    """Return which parameters follow something that was `beside` the runs, by Kendall's rank correlation, p below 5 %.

    Four runs can't show anything that way: the probability that they rise or fall by chance is 2/4!.
    """
    from scipy.stats import kendalltau

    correlations = []
    for what, values in beside.items():
        x = np.array(values, dtype=np.float64)
        if not np.isfinite(x).all() or np.ptp(x) == 0:
            continue
        for name in names:
            tau, p = kendalltau(x, [fit[name].value for fit in fits])
            if p < 0.05:
                correlations.append(Trend(parameter=name, follows=what, sense=int(np.sign(tau)), p=float(p)))
    return tuple(correlations)


def follows_the_angle(names: Sequence[str], fits: Sequence[Fit]) -> tuple[Trend, ...]:
    """Return which parameters depend on the angle that a run started at: a sine of one turn explains them, p below 5 % (F test).

    Only for positions in rad, and from six runs on.
    """
    from scipy.stats import f

    records = [fit.records[0].data for fit in fits]
    if len(fits) < 6 or any(record.kind != "position" or record.position_unit != "rad" for record in records):
        return ()
    angle = np.array([record.y[0] for record in records])
    basis = np.column_stack([np.ones(len(angle)), np.cos(angle), np.sin(angle)])
    if np.linalg.matrix_rank(basis, tol=1e-3) < 3:
        return ()
    dependences = []
    for name in names:
        y = np.array([fit[name].value for fit in fits])
        rest = float(np.sum((y - basis @ np.linalg.lstsq(basis, y, rcond=None)[0]) ** 2))
        explained = float(np.sum((y - y.mean()) ** 2)) - rest
        p = float(f.sf(explained / 2 / (rest / (len(y) - 3)), 2, len(y) - 3)) if rest > 0 else 0.0
        if p < 0.05:
            dependences.append(Trend(parameter=name, follows="the angle at the start", sense=0, p=p))
    return tuple(dependences)


def _logarithms(fits: Sequence[Fit]) -> tuple[Array, Array]:
    """The logarithms of the parameters (N, 2 or 3), and the mean of their stated covariances; friction where it is known."""
    known = all(
        "coulomb_voltage" in fit.estimates
        and fit["coulomb_voltage"].value > _KNOWN * fit["coulomb_voltage"].sd
        for fit in fits
    )
    axes = _AXES if known else _AXES[:2]
    logs, noise = [], np.zeros((len(axes), len(axes)))
    for fit in fits:
        at = [fit.model.names.index(name) for name in axes]
        values = fit.model.theta[at]
        logs.append(np.log(np.abs(values)))
        noise += fit.covariance[np.ix_(at, at)] / np.outer(values, values) / len(fits)
    return np.array(logs), noise
