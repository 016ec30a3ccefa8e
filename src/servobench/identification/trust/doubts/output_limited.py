"""An output that stops rising before the input does."""

from __future__ import annotations

import numpy as np

from servobench.core.channels import Array
from servobench.core.finding import Finding, warning
from servobench.core.rounding import with_unit
from servobench.identification.estimators.base import Fit
from servobench.identification.trust.doubts.base import DOUBTS, Doubt

_UPPER = (
    0.7  # of the highest speed simulated: what lies above is compared with what lies between the next two
)
_LOWER = (0.1, 0.6)
_FLAT = 0.4  # of the slope below: of 40 real motors' speeds the flattest keeps 0.5
_FEWEST = 20  # samples in either range
_CERTAIN = 2.0  # standard errors


def _about_fit(fit: Fit) -> list[Finding]:
    """Whether the measured speed follows the simulated one up to some speed only, in either direction.

    A sensor at the end of its range shows values at one level; where noise is added behind it, no two of them are the same.
    """
    if fit.records[0].data.kind != "speed":
        return []
    simulated = np.concatenate([each.prediction[each.valid] for each in fit.records])
    measured = np.concatenate([each.data.y[each.valid] for each in fit.records])
    for sign in (1.0, -1.0):
        limit = _limit(sign * simulated, sign * measured)
        if limit is not None:
            return [_finding(with_unit(sign * limit, fit.records[0].data.output_unit))]
    return []


def _limit(simulated: Array, measured: Array) -> float | None:
    """The speed beyond which the measured one hardly rises any more; None where it goes on rising."""
    top = float(np.percentile(simulated, 99.5))
    upper = simulated > _UPPER * top
    lower = (simulated > _LOWER[0] * top) & (simulated < _LOWER[1] * top)
    if top <= 0 or min(upper.sum(), lower.sum()) < _FEWEST:
        return None
    above, error = _slope(simulated[upper], measured[upper])
    below, _ = _slope(simulated[lower], measured[lower])
    if above + _CERTAIN * error >= _FLAT * below:
        return None
    limit = float(np.median(measured[upper]))
    # What stands at the end of its range has reached it: a shaft that stands where the model turns is no such thing.
    return limit if limit > np.median(measured[lower]) else None


def _slope(x: Array, y: Array) -> tuple[float, float]:
    """The slope of a line through points, and its standard error; infinite where x stands still.

    What is left over counts as a first-order process: with a correlation ρ from one sample to the next, N samples are worth
    N (1 - ρ)/(1 + ρ) (Bartlett 1946).
    """
    x, y = x - x.mean(), y - y.mean()
    spread = float(x @ x)
    if spread == 0:
        return np.inf, np.inf
    slope = float(x @ y) / spread
    rest = y - slope * x
    variance = float(rest @ rest)
    alike = max(float(rest[1:] @ rest[:-1]) / variance, 0.0) if variance > 0 else 0.0
    worth = max(len(x) * (1.0 - alike) / (1.0 + alike), 3.0)
    return slope, float(np.sqrt(variance / spread / (worth - 2.0)))


def _finding(limit: str) -> Finding:
    return warning(
        "output-limited",
        f"The output hardly rises beyond {limit}, where the model's goes on rising: the sensor's range or the supply ends there, "
        "or the motor settles in another way than a first-order one, as with a driver that drives harder than it brakes. Record "
        "steps to several speeds, and see whether they all end there.",
        parameters=("gain", "coulomb_voltage"),
    )


DOUBTS.member("output_limited")(Doubt(codes=("output-limited",), about_fit=_about_fit))
