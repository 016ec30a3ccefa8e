"""The bars that say what the intervals are made of."""

from types import SimpleNamespace
from typing import Any

from servobench.core.estimate import Estimate
from servobench.identification.uncertainty.composition import BudgetLine
from servobench.identification.uncertainty.identifiability import ParameterStatus, State
from servobench.report.tables import budget_rows


def test_a_source_has_the_same_colour_in_all_bars() -> None:
    """Parts are sorted by size, which differs from parameter to parameter; a colour that followed the size would mislead."""
    estimate = Estimate(value=1.0, sd=0.25, interval=(0.5, 1.5), level=0.95, unit="s")
    names = ("gain", "time_constant")
    answers = {name: ParameterStatus(name=name, state=State.KNOWN, estimate=estimate) for name in names}
    shares = {"noise": (0.9, 0.2), "model error": (0.1, 0.8)}
    budget = [
        BudgetLine(
            source=source,
            reason="",
            freedom=1.0,
            shares=dict(zip(names, of_each, strict=True)),
            half_widths={name: 0.5 * share**0.5 for name, share in zip(names, of_each, strict=True)},
        )
        for source, of_each in shares.items()
    ]
    result: Any = SimpleNamespace(answers=answers, budget=budget)

    gain, time_constant = budget_rows(result)

    assert [part[0] for part in gain.parts] == ["noise", "model error"]
    assert [part[0] for part in time_constant.parts] == ["model error", "noise"]
    colours = [{part[0]: part[4] for part in row.parts} for row in (gain, time_constant)]
    assert colours[0] == colours[1]
    assert len(set(colours[0].values())) == 2
