"""The scatter of one parameter between runs, compared with the standard deviations of the runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from servobench.core.channels import Array
from servobench.core.crossing import crossing
from servobench.core.parameter_names import parameter_in_words
from servobench.core.rounding import TWO_SIDED


@dataclass(frozen=True, kw_only=True)
class Scatter:
    """One parameter, by `name` and in its `unit`, in n runs: `values` and stated `sds`, and what they say together.

    Of a combination of parameters `meaning` says what it is, in words.

    `q` is Cochran's Σ (yᵢ - ȳ)²/sᵢ², χ² with n - 1 degrees of freedom if the runs differ by no more than they say, with `p` the
    probability of more. `ratio` is the observed scatter over the stated one (Birge 1932), `ratio_interval` its 95 %
    interval, wide for few runs. `between` is the standard deviation from run to run that the stated ones leave over (Paule and
    Mandel 1982). `covered` of the runs' intervals hold what the other runs say. `differs` says that the runs differ for
    certain; `mean` has the `interval` that holds between runs (95 %), and `stated` is the one that follows from what the runs
    say of themselves.
    """

    name: str
    unit: str
    values: tuple[float, ...]
    sds: tuple[float, ...]
    q: float
    p: float
    ratio: float
    ratio_interval: tuple[float, float]
    between: float
    covered: int
    differs: bool
    mean: float
    interval: tuple[float, float]
    stated: tuple[float, float]
    meaning: str = ""

    @property
    def label(self) -> str:
        """Its name for people."""
        return self.meaning or parameter_in_words(self.name, self.unit)

    def to_dict(self) -> dict[str, Any]:
        """Return the same as plain data."""
        return {
            "unit": self.unit,
            "meaning": self.meaning,
            "values": list(self.values),
            "sds": list(self.sds),
            "q": self.q,
            "p": self.p,
            "ratio": self.ratio,
            "ratio_interval": list(self.ratio_interval),
            "between": self.between,
            "covered": self.covered,
            "differs": self.differs,
            "mean": self.mean,
            "interval": list(self.interval),
            "stated": list(self.stated),
        }


def scatter(name: str, unit: str, values: Sequence[float], sds: Sequence[float], chance: float) -> Scatter:
    """Return how n >= 2 values with their stated standard deviations scatter; they differ where p is below `chance`.

    The interval of the mean is that of Hartung and Knapp (2001): quantiles of Student's t for n - 1 degrees of freedom, and
    the scatter about the mean as it was seen, at least as it was stated.
    """
    from scipy.stats import chi2, t

    y, s = np.array(values, dtype=np.float64), np.array(sds, dtype=np.float64)
    freedom = len(y) - 1
    plain = 1 / s**2
    mean = float(plain @ y / plain.sum())
    q = float(plain @ (y - mean) ** 2)
    p = float(chi2.sf(q, freedom))
    differs = p < chance
    between = paule_mandel(y, s) if differs else 0.0
    weights = 1 / (s**2 + between**2)
    centre = float(weights @ y / weights.sum())
    reduced_chi_square = float(weights @ (y - centre) ** 2) / freedom
    wide = float(t.ppf(0.975, freedom) * np.sqrt(max(reduced_chi_square, 1.0) / weights.sum()))
    narrow = TWO_SIDED / float(np.sqrt(plain.sum()))
    half = wide if differs else narrow
    ends = [float(np.sqrt(q / chi2.ppf(level, freedom))) for level in (0.975, 0.025)]
    return Scatter(
        name=name,
        unit=unit,
        values=tuple(map(float, y)),
        sds=tuple(map(float, s)),
        q=q,
        p=p,
        ratio=float(np.sqrt(q / freedom)),
        ratio_interval=(ends[0], ends[1]),
        between=between,
        covered=_count_covered(y, s),
        differs=differs,
        mean=centre,
        interval=(centre - half, centre + half),
        stated=(mean - narrow, mean + narrow),
    )


def paule_mandel(y: Array, s: Array) -> float:
    """Return the standard deviation τ between runs for which Σ (yᵢ - ȳ)²/(sᵢ² + τ²) is n - 1; 0 where it is less without any.

    y (n,) are their values, s (n,) the stated standard deviations.

    The sum falls with τ, from above n - 1 to below 1 where τ² is the sum of squares.
    """

    def excess(variance: float) -> float:
        weights = 1 / (s**2 + variance)
        centre = weights @ y / weights.sum()
        return float(weights @ (y - centre) ** 2) - (len(y) - 1)

    if excess(0.0) <= 0:
        return 0.0
    return float(np.sqrt(crossing(excess, 0.0, float(np.sum((y - y.mean()) ** 2)))))


def _count_covered(y: Array, s: Array) -> int:
    """The number of values within 1.96 stated standard deviations of the mean of the others, whose own is counted in."""
    count = 0
    for n in range(len(y)):
        rest = np.arange(len(y)) != n
        weights = 1 / s[rest] ** 2
        off = y[n] - weights @ y[rest] / weights.sum()
        count += bool(abs(off) <= TWO_SIDED * np.sqrt(s[n] ** 2 + 1 / weights.sum()))
    return count
