"""The kind `explanations`: causes that a bad fit may have, which are tried against each other on the data.

Where the residuals of a fit object, or no fit was possible, each explanation says by how much it makes the motor's equation
(`equation`) hold better. The best one is told, if it is a good one: then the user knows what to mend, and not only that something
is wrong.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np

from servobench.channels import Array
from servobench.explanations.equation import Motion, Regression, joined, motion, regression
from servobench.finding import Finding, Severity
from servobench.measurement.dataset import Dataset
from servobench.registry import Registry

_CONVINCING = 0.6  # of the misfit may be left where a cause is told
_CERTAIN = 0.3  # of the misfit may be left where no richer structure is tried
_AS_GOOD = 1.15  # times the least misfit of all causes: that much is chance, and the simpler cause is told


@dataclass(frozen=True, eq=False)
class Case:
    """The records on even grids, as `motions`, and how well the motor's equation holds without any further cause.

    `simulated` is the part of the output that the simulation of a fit explains, in percent; NaN where there is no fit.
    """

    motions: tuple[Motion, ...]
    simulated: float = np.nan

    @cached_property
    def base(self) -> tuple[Array, Array]:
        """The columns (R, 5) of τ, K, K d, K u_c and K u₀, and the speed (R,)."""
        return joined(self.motions)

    @cached_property
    def plain(self) -> Regression:
        """The equation without any further cause."""
        return regression(*self.base)

    def with_columns(self, *extra: Sequence[Array]) -> Regression:
        """Return the equation with further columns, each given as one array (R_r,) a record."""
        columns, speed = self.base
        return regression(np.column_stack([columns, *(np.concatenate(list(each)) for each in extra)]), speed)

    def with_input(self, change: Callable[[Motion], Array], *extra: Sequence[Array]) -> Regression:
        """Return the equation with another input (N,) in place of each record's."""
        columns, speed = self.base
        changed = [change(each) for each in self.motions]
        columns = columns.copy()
        columns[:, 1] = np.concatenate([m.caused(u) for m, u in zip(self.motions, changed, strict=True)])
        columns[:, 2] = -np.concatenate([m.caused(u, 1) for m, u in zip(self.motions, changed, strict=True)])
        return regression(np.column_stack([columns, *(np.concatenate(list(each)) for each in extra)]), speed)


@dataclass(frozen=True, kw_only=True)
class Explained:
    """A cause that fits: its finding, the misfit that is left, and how many numbers it had to choose (`chosen`).

    `structural` is a cause that lies in the motor, so that a richer structure may have it; the others lie in the record.
    """

    finding: Finding
    misfit: float
    chosen: int = 1
    structural: bool = False


Explain: TypeAlias = Callable[[Case], Explained | None]

# What says that something is wrong, and not what.
_SYMPTOMS = frozenset(
    {
        "fit-poor",
        "lag-not-split",
        "parameter-at-bound",
        "parameter-uncertain",
        "parameter-unknown",
        "residual-coloured",
        "residual-follows-input",
        "search-not-settled",
        "validation-poor",
        "validation-worse",
        "not-identifiable",
    }
)
# What says what is wrong: then nothing further is looked for.
_CAUSES = frozenset(
    {
        "angle-wraps",
        "gap-input-unknown",
        "input-constant",
        "input-is-output",
        "output-clipped",
        "output-spikes",
        "output-still",
        "output-stops",
    }
)

# What the explanations themselves say.
_EXPLAINED = frozenset(
    {
        "clock-drift",
        "dead-zone",
        "delay-negative",
        "drag-not-linear",
        "gain-falls",
        "hysteresis",
        "input-unrelated",
        "level-disagrees",
        "motor-changes",
        "records-disagree",
        "response-oscillates",
        "second-pole",
        "sign-flips",
    }
)

EXPLANATIONS: Registry[Explain] = Registry("explanation", "servobench.explanations")


def unexplained(findings: Sequence[Finding]) -> bool:
    """Return whether findings say that something is wrong with a fit, and none says what."""
    grave = {finding.code for finding in findings if finding.severity != Severity.INFO}
    return bool(grave & _SYMPTOMS) and not grave & _CAUSES


def names_a_cause(findings: Sequence[Finding]) -> bool:
    """Return whether findings about the data say already what is wrong with them."""
    return any(finding.code in _CAUSES for finding in findings if finding.severity != Severity.INFO)


def is_cause(finding: Finding) -> bool:
    """Return whether a finding says what is wrong with the data or the motor, and not only that something is."""
    return finding.severity != Severity.INFO and finding.code in _CAUSES | _EXPLAINED


def explain(records: Sequence[Dataset], simulated: float = np.nan) -> list[Finding]:
    """Return the finding of the cause that explains best why no model fits these records; none where no cause does.

    `simulated` is what the simulation of the best fit explains of the output, in percent; NaN where there is no fit.
    """
    best = _best(records, _CONVINCING, simulated)
    return [] if best is None else [best.finding]


def is_damaged(records: Sequence[Dataset], simulated: float = np.nan) -> bool:
    """Return whether a cause that lies in the records, and not in the motor, explains nearly all that a plain motor doesn't.

    Then richer structures needn't be tried: they would bend to the damage, and take long. `simulated` is as in `explain`.
    """
    best = _best(records, _CERTAIN, simulated)
    return best is not None and not best.structural


def _best(records: Sequence[Dataset], most: float, simulated: float) -> Explained | None:
    """The cause that leaves least of the misfit, and at most that part of it."""
    motions = [found for found in map(motion, records) if found is not None]
    if not motions or len(motions) < len(records):
        return None
    case = Case(tuple(motions), simulated)
    found = [each for each in (member(case) for member in EXPLANATIONS) if each is not None]
    good = [each for each in found if each.misfit <= most * case.plain.misfit]
    if not good:
        return None
    least = min(each.misfit for each in good)
    return min(
        (each for each in good if each.misfit <= _AS_GOOD * least),
        key=lambda each: (each.chosen, each.misfit),
    )
