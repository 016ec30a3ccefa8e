"""A row of a fleet's table: what is known of one motor, or why nothing is."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from servobench._version import __version__
from servobench.core.finding import Severity, Verdict
from servobench.fleet.source import Item
from servobench.identification.result import Result

IDENTIFIED, UNUSABLE, CRASHED = "identified", "unusable", "crashed"
"""The outcome of a file: a result, an error that says why not, or the end of the process that read it."""

Row = dict[str, Any]

TEXTS = frozenset({
    "file", "stamp", "outcome", "verdict", "reason", "structure", "estimator", "budget", "good_for", "sha256", "version",
})  # fmt: skip
LISTS = frozenset({"findings", "sentences"})
COUNTS = frozenset({"samples"})


def row_of_failure(item: Item, columns: Mapping[str, str], outcome: str, reason: str) -> Row:
    """Return the row of a file that has no result."""
    return {
        "file": item.text,
        **columns,
        "outcome": outcome,
        "reason": reason,
        "stamp": item.stamp,
        "version": __version__,
    }


def result_row(item: Item, columns: Mapping[str, str], result: Result) -> Row:
    """Return the row of a result.

    A parameter x has the columns `x`, `x_sd`, `x_low`, `x_high` (its 95 % interval), `x_unit` and `x_state`, and `x_input` and
    `x_input_unit` if it holds at one level of the input; numbers that aren't finite are left out.
    """
    document = result.to_dict(derived=False)
    row: Row = {
        "file": item.text,
        **columns,
        "outcome": IDENTIFIED,
        "verdict": document["verdict"],
        "reason": _reason(result),
        "structure": document["structure"],
        "estimator": document["estimator"],
    }
    for name, each in {
        **document["parameters"],
        **document["combinations"],
        **document["motor_parameters"],
    }.items():
        low, high = each["interval"]
        state = each.get("state") or "known"
        row |= {name: each["value"], f"{name}_sd": each["sd"], f"{name}_low": low, f"{name}_high": high}
        row |= {f"{name}_unit": each["unit"], f"{name}_state": state}
    for combination in result.combinations:
        if combination.input_level is not None:
            row[f"{combination.name}_input"] = combination.input_level
            row[f"{combination.name}_input_unit"] = combination.input_unit
    return row | {
        "findings": [each.code for each in result.findings],
        "sentences": [each.sentence for each in result.findings],
        "budget": json.dumps(document["budget"], ensure_ascii=False),
        "good_for": document["good_for"],
        "fit_percent": document["fit_percent"]["training"],
        "validation_percent": document["fit_percent"]["validation"],
        "samples": sum(each["samples"] for each in document["records"]),
        "duration": sum(each["duration"] for each in document["records"]),
        "sample_time": document["records"][0]["sample_time"]["median"] if document["records"] else None,
        "sha256": " ".join(document["provenance"]["inputs_sha256"]),
        "stamp": item.stamp,
        "version": __version__,
    }


def _reason(result: Result) -> str:
    """The reason why a result is refused or doubtful, its first sentence; empty where it is trusted."""
    wanted = {
        Verdict.REFUSED: (Severity.REFUSAL,),
        Verdict.DOUBTFUL: (Severity.DANGER, Severity.WARNING),
        Verdict.TRUSTED: (),
    }[result.verdict]
    return next((each.sentence for each in result.findings if each.severity in wanted), "")
