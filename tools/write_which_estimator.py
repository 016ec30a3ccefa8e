"""Write docs/which-estimator.md from what the estimators declare and what a fit was measured to cost.

A test holds the page equal to this. Run `make generate` after a change of a declaration, or after
`python bench/estimator_costs.py`.
"""

import json
import sys
from dataclasses import fields
from pathlib import Path

from servobench.core.rounding import with_unit
from servobench.identification.estimators.base import ESTIMATORS, Abilities

DOCS = Path(__file__).resolve().parent.parent / "docs"
PAGE = DOCS / "which-estimator.md"
COSTS = DOCS / "benchmarks" / "cost.json"

HEAD = """# Which estimator

<!-- Written by tools/write_which_estimator.py from the estimators' own declarations: change those, run `make generate`. -->

`servobench identify FILE` chooses by itself: it fits by `output_error`, asks by a likelihood ratio whether a random torque
acts on the motor, and takes `prediction_error` where it does ([how that works](why/three-likelihoods.md)).
`--estimator NAME`, or `identify(data, estimator="NAME")`, takes another. This page says what each one is for.

## What each one can do
"""

LEGEND = """
● it can. Without a mark an estimator refuses such data, or says in its findings what it left out.
"""

# In the order of the columns: what an ability is called in the heading, and what it means.
MEANINGS = {
    "position": ("position", "the output may be a position, such as an encoder's counts"),
    "speed": ("speed", "the output may be a speed"),
    "chain": (
        "chain",
        "a filter, difference or average between shaft and data is part of the prediction, so that its lag isn't taken for the "
        "motor's ([why](why/chain-in-the-estimator.md))",
    ),
    "irregular_times": ("irregular times", "samples need not be evenly spaced, nor input and output simultaneous"),
    "several_records": ("several records", "records are fitted jointly, each with its own start state"),
    "closed_loop": ("closed loop", "a controller that feeds the measured output's noise back into the input makes no bias"),
    "delay": ("delay", "a delay is estimated, in fractions of a sample"),
    "friction": ("friction", "Coulomb friction with rest and reversals"),
    "disturbance": ("random torque", "the intervals hold under a torque that acts at random"),
}  # fmt: skip


def page(costs: Path = COSTS) -> str:
    """Return the page."""
    told = json.loads(costs.read_text(encoding="utf-8")) if costs.exists() else {}
    return "\n".join([HEAD, *_table(told), LEGEND, *_meanings(), "", *_sections(), *_about_costs(told)])


def write(file: Path = PAGE) -> None:
    """Write the page."""
    file.write_text(page(), encoding="utf-8", newline="\n")


def _table(costs: dict[str, float]) -> list[str]:
    _check_meanings()
    headings = ["estimator", *(heading for heading, _ in MEANINGS.values()), "one fit"]
    rows = [f"| {' | '.join(headings)} |", f"| --- |{' :-: |' * len(MEANINGS)} ---: |"]
    for name in ESTIMATORS.names():
        marks = ["●" if getattr(ESTIMATORS[name].abilities, ability) else "" for ability in MEANINGS]
        cost = with_unit(costs[name], "s", 2) if name in costs else "not measured"
        rows.append(f"| {' | '.join([f'[`{name}`](#{name})', *marks, cost])} |")
    return rows


def _check_meanings() -> None:
    """A new ability needs a heading, or the page would leave it out in silence."""
    declared = {field.name for field in fields(Abilities)} - {"method", "noise", "interval"}
    if declared != set(MEANINGS):
        raise SystemExit(f"tools/write_which_estimator.py: say what {declared ^ set(MEANINGS)} means")


def _meanings() -> list[str]:
    return [f"- *{heading}*: {meaning}." for heading, meaning in MEANINGS.values()]


def _sections() -> list[str]:
    lines = []
    for name in ESTIMATORS.names():
        can = ESTIMATORS[name].abilities
        lines += [f"## {name}", "", f"{can.method[:1].upper()}{can.method[1:]}.", ""]
        lines += [f"- Noise it is right for: {can.noise}.", f"- Its intervals: {can.interval}.", ""]
    return lines


def _about_costs(costs: dict[str, float]) -> list[str]:
    if not costs:
        return ["## Costs", "", "Not measured yet: `python bench/estimator_costs.py` does.", ""]
    return [
        "## Costs",
        "",
        "The processor time of one fit of the paper's experiment (square wave of 1 to 3 V, 0.4 Hz, 5,000 samples), everything "
        f"compiled, a median, measured on {costs['date']} on {costs['machine']} by `python bench/estimator_costs.py`.",
        "",
    ]


if __name__ == "__main__":
    write()
    sys.exit(0)
