"""The identified first-order motor, in the user's unit of position: the basis of all controllers."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from servobench.core.channels import Array
from servobench.core.estimate import Estimate
from servobench.core.rounding import TWO_SIDED


@dataclass(frozen=True, kw_only=True, eq=False)
class FirstOrderMotor:
    """τ dω/dt = -ω + K (u(t - d) - u₀ - u_c sgn ω), with positions in `unit` (source: see `identification.models.first_order`).

    `gain` K [unit/(s·V)], `time_constant` τ [s], `delay` d [s], not negative; `coulomb_voltage` u_c [V] and `offset_voltage`
    u₀ [V] are None where the structure has none; `one_way` says that it turned one way only, so that one
    voltage stands for both. `moments` are the covariance (3, 3) of K, τ and d. `doubtful` is the verdict on where it comes from,
    `cautions` say what isn't known of it.
    """

    unit: str
    gain: Estimate
    time_constant: Estimate
    delay: float
    coulomb_voltage: Estimate | None
    offset_voltage: Estimate | None
    one_way: bool
    moments: Array
    doubtful: bool = False
    cautions: tuple[str, ...] = ()

    def draws(self, count: int) -> Array:
        """Return parameters (count, 3), K, τ and d, as the data leave them open; the same ones each time.

        Those that aren't known stay what they are. A gain keeps its sign, a time constant and a delay don't become negative.
        """
        centre = np.array([self.gain.value, self.time_constant.value, self.delay])
        spread = np.where(np.isfinite(self.moments), self.moments, 0.0)
        parameters = np.random.default_rng(7).multivariate_normal(
            centre, spread, size=count, check_valid="ignore"
        )
        parameters[:, 0] = np.where(parameters[:, 0] * centre[0] > 0, parameters[:, 0], centre[0])
        parameters[:, 1] = np.where(parameters[:, 1] > 0, parameters[:, 1], centre[1])
        parameters[:, 2] = np.maximum(parameters[:, 2], 0.0)
        return parameters


def scale_estimate(estimate: Estimate, factor: float, name: str) -> Estimate:
    """Return an estimate times a factor, in the unit of that name."""
    ends = sorted(factor * end for end in estimate.interval)
    return Estimate(
        value=factor * estimate.value,
        sd=abs(factor) * estimate.sd,
        interval=(ends[0], ends[1]),
        level=estimate.level,
        unit=name,
    )


def inverse(estimate: Estimate, name: str) -> Estimate:
    """Return 1/x with the interval that x has; unknown where the interval of x reaches across zero."""
    low, high = estimate.interval
    ends = sorted((1 / low, 1 / high)) if low * high > 0 else [math.nan, math.nan]
    return Estimate(
        value=1 / estimate.value,
        sd=estimate.sd / estimate.value**2,
        interval=(ends[0], ends[1]),
        level=estimate.level,
        unit=name,
    )


def ratio(over: Estimate, under: Estimate, covariance: float, name: str) -> Estimate:
    """Return x/y, its variance to first order with the covariance of the two, and value ± 1.96 sd."""
    value = over.value / under.value
    variance = over.sd**2 - 2 * value * covariance + value**2 * under.sd**2
    sd = math.sqrt(max(variance, 0.0)) / abs(under.value) if math.isfinite(variance) else math.nan
    return Estimate(
        value=value,
        sd=sd,
        interval=(value - TWO_SIDED * sd, value + TWO_SIDED * sd),
        level=over.level,
        unit=name,
    )
