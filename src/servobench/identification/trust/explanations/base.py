"""The kind `explanations`: possible causes of a bad fit, compared on the data.

If the residuals of a fit have a pattern, or no fit was possible, each explanation says by how much it improves the motor's
equation (`equation`). The best one is reported if a fit confirms it (`trial`), so that the user knows what to correct. No cause
is reported without evidence of its own (docs/decisions/0040-causes.md).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np

from servobench.core.channels import Array
from servobench.core.finding import Finding, Severity, lower_first
from servobench.core.finding_codes import Role, codes_of
from servobench.core.registry import Registry
from servobench.core.rounding import plain
from servobench.identification.estimators.base import Fit
from servobench.identification.trust.explanations.cause import CauseFit
from servobench.identification.trust.explanations.equation import (
    Motion,
    Regression,
    join_base,
    motion,
    regression,
)
from servobench.identification.trust.explanations.trial import fit_plainly, is_confirmed
from servobench.recordings.measurement.dataset import Dataset

_CONVINCING = 0.6  # of the misfit may be left if a cause is reported
_NEARLY_ALL = 95.0  # percent of the output: below it a cause is looked for although nothing else shows one
_ENOUGH = 100  # samples in each record, to look for the cause of the little that a good fit leaves over
_EXPLAINED_ALREADY = 90.0  # percent of the output: a model that simulates more is right enough for its intervals to hold the rest
_CERTAIN = 0.3  # of the misfit may be left where no richer structure is tried
_TRIALS = 3  # causes that are fitted, the most promising first
_AS_GOOD = (
    1.15  # times the least misfit of all causes: that much is chance, and the simpler cause is reported
)


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
        return join_base(self.motions)

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
        columns[:, 1] = np.concatenate(
            [m.filter_through_chain(u) for m, u in zip(self.motions, changed, strict=True)]
        )
        columns[:, 2] = -np.concatenate(
            [m.filter_through_chain(u, 1) for m, u in zip(self.motions, changed, strict=True)]
        )
        return regression(np.column_stack([columns, *(np.concatenate(list(each)) for each in extra)]), speed)


Explain: TypeAlias = Callable[[Case], CauseFit | None]

_SYMPTOMS = codes_of(Role.SYMPTOM)
_CAUSES = codes_of(Role.CAUSE)
_EXPLAINED = codes_of(Role.EXPLANATION)

EXPLANATIONS: Registry[Explain] = Registry(
    "explanation", "servobench.identification.trust.explanations", "servobench.explanations"
)


def is_unexplained(findings: Sequence[Finding], simulated: float = np.nan) -> bool:
    """Return whether something is wrong with a fit, by its findings or by what it leaves over, and no finding says what.

    `simulated` is what the simulation of the fit explains of the output, in percent; NaN where there is no fit.
    """
    grave = {finding.code for finding in findings if finding.severity != Severity.INFO}
    symptoms = {finding.code for finding in findings} & _SYMPTOMS
    return (bool(symptoms) or simulated < _NEARLY_ALL) and not grave & _CAUSES


def names_a_cause(findings: Sequence[Finding]) -> bool:
    """Return whether findings about the data say already what is wrong with them."""
    return any(finding.code in _CAUSES for finding in findings if finding.severity != Severity.INFO)


def is_cause(finding: Finding) -> bool:
    """Return whether a finding says what is wrong with the data or the motor, and not only that something is."""
    return finding.severity != Severity.INFO and finding.code in _CAUSES | _EXPLAINED


def _as_a_remark(cause: Finding, simulated: float) -> Finding:
    """The finding on a cause of the little that a model leaves over, which explains `simulated` percent of the output."""
    left = f"The model leaves {plain(100 - simulated, 2)} % of the output unexplained, which the intervals allow for"
    return replace(
        cause, severity=Severity.INFO, sentence=f"{left}. The likeliest cause: {lower_first(cause.sentence)}"
    )


@dataclass(frozen=True, eq=False)
class Causes:
    """The possible causes of bad fits. Each is looked for and fitted once, however often it is requested.

    `known` are output error's fits of these records by the names of their structures, as far as they have been made.
    """

    records: tuple[Dataset, ...]
    known: Mapping[str, Fit] = field(default_factory=dict)

    def explain(self, simulated: float = np.nan, of_gain: float = 0.0) -> list[Finding]:
        """Return the finding of the cause that explains best why no model fits these records; none where no cause does.

        `simulated` is what the simulation of the best fit explains of the output, in percent; NaN where there is no fit.
        `of_gain` is the half-width of the gain's interval as a part of the gain: a cause that changes it by less is a remark.
        """
        best = self._best(_CONVINCING, simulated)
        if best is None:
            return []
        has_a_size = (best.structural and simulated >= _EXPLAINED_ALREADY) or best.change <= of_gain
        return [_as_a_remark(best.finding, simulated) if has_a_size else best.finding]

    def are_damage(self, simulated: float = np.nan) -> bool:
        """Return whether a cause that lies in the records, and not in the motor, explains nearly all that a plain motor doesn't.

        Then richer structures needn't be tried: they would bend to the damage, and take long. `simulated` is as in `explain`.
        """
        best = self._best(_CERTAIN, simulated)
        return best is not None and not best.structural

    def _best(self, most: float, simulated: float) -> CauseFit | None:
        """The cause that leaves least of the misfit, and at most that part of it, of those that a fit bears out."""
        motions = self._motions
        if not motions or len(motions) < len(self.records):
            return None
        if simulated >= _NEARLY_ALL and min(len(record.y) for record in self.records) < _ENOUGH:
            return None
        if simulated not in self._found:
            case = Case(motions, simulated)
            explained = (member(case) for member in EXPLANATIONS)
            self._found[simulated] = case, [each for each in explained if each is not None]
        case, cause_fits = self._found[simulated]
        good = [each for each in cause_fits if each.misfit <= most * case.plain.misfit]
        return next((each for each in _rank(good)[:_TRIALS] if self._is_evident(each)), None)

    def _is_evident(self, cause: CauseFit) -> bool:
        if cause.remedy is None and not cause.structure:
            return True
        if cause not in self._tried:
            self._tried[cause] = is_confirmed(cause, self.records, self._without)
        return self._tried[cause]

    @cached_property
    def _motions(self) -> tuple[Motion, ...]:
        return tuple(grid_motion for grid_motion in map(motion, self.records) if grid_motion is not None)

    @cached_property
    def _without(self) -> Fit | None:
        return fit_plainly(self.records, self.known)

    @cached_property
    def _found(self) -> dict[float, tuple[Case, list[CauseFit]]]:
        """The causes that may be, for what a simulation explains."""
        return {}

    @cached_property
    def _tried(self) -> dict[CauseFit, bool]:
        """Whether a fit bears a cause out."""
        return {}


def explain(records: Sequence[Dataset], simulated: float = np.nan) -> list[Finding]:
    """Return the same as `Causes.explain` for records that nothing is known of yet."""
    return Causes(tuple(records)).explain(simulated)


def _rank(causes: Sequence[CauseFit]) -> list[CauseFit]:
    """The causes that leave about the least first, the simplest of them before the others, then the rest."""
    least = min((each.misfit for each in causes), default=0.0)
    return sorted(
        causes,
        key=lambda each: (
            (each.misfit > _AS_GOOD * least, each.chosen, each.misfit)
            if each.misfit <= _AS_GOOD * least
            else (True, 0, each.misfit)
        ),
    )
