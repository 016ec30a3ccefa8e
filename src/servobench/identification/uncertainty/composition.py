"""The composition of each interval's width: the lines of a fit's budget as shares of the variance of each parameter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from servobench.core.rounding import TWO_SIDED
from servobench.identification.estimators.base import Fit
from servobench.identification.uncertainty.identifiability import ParameterStatus, State

MEASUREMENT = "measurement and disturbance"
_COUNTS = 1e-4  # of a variance: what is less isn't reported


@dataclass(frozen=True, kw_only=True)
class BudgetLine:
    """One line of a budget of uncertainty, for those parameters in whose variance it has a part.

    `shares` are parts of the variance, which add up to 1 over all lines; `half_widths` of 95 % intervals, in the unit of each
    parameter, whose squares add up. `freedom` is infinite where the line isn't estimated.
    """

    source: str
    """The source, in a few words."""
    shares: Mapping[str, float]
    half_widths: Mapping[str, float]
    freedom: float
    reason: str
    """The reason, as a part of a sentence."""


def composition(fit: Fit) -> tuple[BudgetLine, ...]:
    """Return the budget of a fit: the estimator's own line first, then what was added to it, without lines that say nothing."""
    variance = np.diag(fit.covariance)
    added = [np.diag(line.covariance) for line in fit.budget]
    own = np.maximum(variance - sum(added, np.zeros_like(variance)), 0.0)
    samples = sum(int(record.valid.sum()) for record in fit.records)
    reason = f"what {fit.estimator} derives from the residual"
    lines = [_line(fit, MEASUREMENT, own, variance, float(samples - len(fit.vector)), reason)]
    for line, part in zip(fit.budget, added, strict=True):
        lines.append(_line(fit, line.source, part, variance, line.freedom, line.reason))
    return tuple(line for line in lines if line.shares)


def parts_of(budget: Sequence[BudgetLine], answer: ParameterStatus | None) -> list[tuple[float, BudgetLine]]:
    """Return the lines that widen the interval of one parameter, each with its half-width in percent of the value, widest first.

    None for a parameter that isn't known by itself, or is zero. Where the interval ends at what can be, and so is narrower than
    all of its lines together, they are smaller by the same factor: no part is larger than the whole.
    """
    if answer is None or answer.state is not State.KNOWN or not answer.estimate.value:
        return []
    widths = [(line.half_widths[answer.name], line) for line in budget if answer.name in line.half_widths]
    together = float(np.linalg.norm([width for width, _ in widths])) or 1.0
    percent = 100 / abs(answer.estimate.value) * min(1.0, answer.estimate.half_width / together)
    return sorted(((percent * width, line) for width, line in widths), key=lambda part: -part[0])


def _line(
    fit: Fit, source: str, part: np.ndarray, whole: np.ndarray, freedom: float, reason: str
) -> BudgetLine:
    parts = {
        name: n
        for n, name in enumerate(fit.model.names)
        if np.isfinite(whole[n]) and part[n] > _COUNTS * whole[n]
    }
    return BudgetLine(
        source=source,
        shares={name: float(part[n] / whole[n]) for name, n in parts.items()},
        half_widths={name: TWO_SIDED * float(np.sqrt(part[n])) for name, n in parts.items()},
        freedom=freedom,
        reason=reason,
    )
