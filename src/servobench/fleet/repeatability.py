"""Gauge repeatability and reproducibility: how much of what is seen the test stand makes itself.

Source: AIAG, *Measurement Systems Analysis*, 4th edition, chapter III: the analysis of variance, with the interaction pooled into
repeatability where it isn't significant; number of distinct categories.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import UsageError
from servobench.core.json_numbers import finite

_POOLED = 0.25  # AIAG: an interaction with a larger p value is pooled
_SPREAD = 6.0  # standard deviations in a study variation
_CATEGORIES = math.sqrt(2)  # ndc = 1.41 parts / gauge


@dataclass(frozen=True, kw_only=True)
class AnovaLine:
    """A line of the analysis of variance: sum of squares, degrees of freedom, mean square; F and p where it is tested."""

    source: str
    """The source of the variation."""
    sum_squares: float
    """The sum of squares, in the square of the unit."""
    dof: int
    """Degrees of freedom."""
    mean_square: float
    f: float | None = None
    p: float | None = None


@dataclass(frozen=True, kw_only=True)
class Component:
    """A part of the variation: variance and its share [%], sd, and 6 sd over those of all and over the tolerance [%]."""

    name: str
    """The name of the part."""
    variance: float
    contribution: float
    """The share of the variance [%]."""
    sd: float
    of_study: float
    """6 sd over those of all [%]."""
    of_tolerance: float | None
    """6 sd over the tolerance [%], None without one."""


@dataclass(frozen=True, kw_only=True)
class GaugeStudy:
    """A study of parts × operators × trials: analysis of variance, components, and how many classes the stand can tell."""

    parts: int
    operators: int
    trials: int
    pooled: bool
    """Whether repeatability includes the interaction."""
    lines: tuple[AnovaLine, ...]
    """The analysis of variance."""
    components: Mapping[str, Component]
    """`gauge`, `repeatability`, `reproducibility`, `operator`, `interaction`, `part` and `total`."""
    categories: int
    """The number of distinct categories; 5 or more are wanted."""

    def to_dict(self) -> dict[str, object]:
        """Return the study as plain data."""
        plain: dict[str, object] = finite(
            {
                "parts": self.parts,
                "operators": self.operators,
                "trials": self.trials,
                "pooled": self.pooled,
                "anova": [vars(line) for line in self.lines],
                "components": {name: vars(each) for name, each in self.components.items()},
                "categories": self.categories,
            }
        )
        return plain


def gauge_study(y: Array, tolerance: float | None = None) -> GaugeStudy:
    """Return the study of measured values y (N, O, K): N parts, O operators, K trials.

    y_ijk = μ + part_i + operator_j + (part × operator)_ij + e_ijk, all random. Mean squares give the variances: e = MS_e,
    interaction = (MS_po - MS_e)/k, operator = (MS_o - MS_po)/(n k), part = (MS_p - MS_po)/(o k), each at least 0; where the
    interaction's p value is above 0.25 it is pooled into e. `tolerance` is the width between the limits, None without two.
    Raises `UsageError` where there are fewer than two parts or trials, or values are missing.
    """
    if y.ndim != 3 or min(y.shape) < 1 or y.shape[0] < 2 or y.shape[2] < 2:
        raise UsageError(
            f"a study of {' × '.join(map(str, y.shape))}: expected at least 2 parts × 1 operator × 2 trials"
        )
    if not np.isfinite(y).all():
        raise UsageError("a value isn't a finite number; leave its part out")
    n, o, k = y.shape
    mean = y.mean()
    parts = o * k * float(((y.mean(axis=(1, 2)) - mean) ** 2).sum())
    operators = n * k * float(((y.mean(axis=(0, 2)) - mean) ** 2).sum())
    cells = k * float(((y.mean(axis=2) - mean) ** 2).sum())
    error = float(((y - y.mean(axis=2, keepdims=True)) ** 2).sum())
    crossed = max(0.0, cells - parts - operators)
    dof = {"part": n - 1, "operator": o - 1, "interaction": (n - 1) * (o - 1), "error": n * o * (k - 1)}
    square = {"part": parts, "operator": operators, "interaction": crossed, "error": error}
    f, p = _test(square["interaction"], dof["interaction"], error, dof["error"])
    pooled = o > 1 and (p is None or p > _POOLED)
    if pooled or o == 1:
        e_square, e_dof = error + crossed, dof["error"] + dof["interaction"]
        against = e_square / e_dof
        between = 0.0
    else:
        e_square, e_dof = error, dof["error"]
        against = crossed / dof["interaction"]
        between = max(0.0, (against - error / dof["error"]) / k)
    noise = e_square / e_dof
    operator = max(0.0, (operators / (o - 1) - against) / (n * k)) if o > 1 else 0.0
    part = max(0.0, (parts / (n - 1) - against) / (o * k))
    lines = [_line("part", parts, n - 1, against, e_dof if pooled or o == 1 else dof["interaction"])]
    if o > 1:
        lines.append(_line("operator", operators, o - 1, against, e_dof if pooled else dof["interaction"]))
        lines.append(
            AnovaLine(source="part × operator", sum_squares=crossed, dof=dof["interaction"],
                      mean_square=crossed / dof["interaction"], f=f, p=p)
        )  # fmt: skip
    lines.append(
        AnovaLine(
            source="repeatability", sum_squares=error, dof=dof["error"], mean_square=error / dof["error"]
        )
    )
    return GaugeStudy(
        parts=n,
        operators=o,
        trials=k,
        pooled=pooled,
        lines=tuple(lines),
        components=_components(noise, operator, between, part, tolerance),
        categories=_categories(part, noise + operator + between),
    )


def _test(square: float, dof: int, error: float, error_dof: int) -> tuple[float | None, float | None]:
    """F and its p value; None where there is nothing to test against."""
    from scipy.stats import f as distribution

    if dof < 1 or error <= 0 or error_dof < 1:
        return None, None
    ratio = (square / dof) / (error / error_dof)
    return ratio, float(distribution.sf(ratio, dof, error_dof))


def _line(source: str, square: float, dof: int, against: float, against_dof: int) -> AnovaLine:
    f, p = _test(square, dof, against * against_dof, against_dof)
    return AnovaLine(source=source, sum_squares=square, dof=dof, mean_square=square / dof, f=f, p=p)


def _components(
    noise: float, operator: float, between: float, part: float, tolerance: float | None
) -> dict[str, Component]:
    reproducibility = operator + between
    gauge = noise + reproducibility
    total = gauge + part
    variances = {
        "gauge": gauge, "repeatability": noise, "reproducibility": reproducibility, "operator": operator,
        "interaction": between, "part": part, "total": total,
    }  # fmt: skip
    return {
        name: Component(
            name=name,
            variance=variance,
            contribution=100 * variance / total if total > 0 else math.nan,
            sd=math.sqrt(variance),
            of_study=100 * math.sqrt(variance / total) if total > 0 else math.nan,
            of_tolerance=100 * _SPREAD * math.sqrt(variance) / tolerance if tolerance else None,
        )
        for name, variance in variances.items()
    }


def _categories(part: float, gauge: float) -> int:
    if gauge <= 0:
        return 10**6 if part > 0 else 1
    return max(1, int(_CATEGORIES * math.sqrt(part / gauge)))


def study_values(
    values: Sequence[float], parts: Sequence[str], operators: Sequence[str], trials: Sequence[str]
) -> Array:
    """Return measured values as an array (N, O, K) of parts, operators and trials, each part measured equally often by each
    operator.

    Within a part and an operator the values are in the order of `trials`. Raises `UsageError` which says where one is missing.
    """
    cells: dict[tuple[str, str], list[tuple[str, float]]] = {}
    for value, part, operator, trial in zip(values, parts, operators, trials, strict=True):
        cells.setdefault((part, operator), []).append((trial, value))
    all_parts, all_operators = sorted(set(parts)), sorted(set(operators))
    most = max((len(each) for each in cells.values()), default=0)
    for part in all_parts:
        for operator in all_operators:
            count = len(cells.get((part, operator), ()))
            if count != most:
                who = f" by {operator}" if operator else ""
                raise UsageError(
                    f"part {part}{who} has {count} usable trials where others have {most}; every part has to be measured equally "
                    "often by every operator"
                )
    return np.array(
        [[[value for _, value in sorted(cells[part, who])] for who in all_operators] for part in all_parts]
    )
