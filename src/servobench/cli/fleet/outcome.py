"""The outcome of a fleet: tables, report, the printed lines, the exit status."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from servobench.cli.failures import DONE, FAILED_LIMITS, REFUSED, UNDECIDED, USER_MISTAKE

if TYPE_CHECKING:
    from rich.console import Console

    from servobench.cli.progress import Progress
    from servobench.fleet.identification import Summary
    from servobench.fleet.limits import Limits
    from servobench.fleet.settings import Settings
    from servobench.fleet.table import Fleet

_MOST_REASONS = 5


def conclude_fleet(
    source: str,
    out: Path,
    settings: Settings,
    limits: Limits | None,
    progress: Progress,
    others: Sequence[str],
    command: str,
) -> tuple[Fleet, dict[str, Any]]:
    """Write tables and report of all rows in a folder; return what is known of all motors, also as plain data."""
    from servobench.fleet.page import write_page_of
    from servobench.fleet.table import fleet_document, fleet_in, write_tables

    progress.begin("writing tables and report")
    fleet = fleet_in(out, limits)
    table, sheet = write_tables(out, fleet)
    page = write_page_of(fleet, source, out, settings, command)
    return fleet, fleet_document(fleet, [table, sheet, page], others)


def show_fleet(console: Console, fleet: Fleet, summary: Summary, out: Path) -> None:
    """Say in some lines what came of the files."""
    from servobench.cli.option_names import with_options
    from servobench.cli.terminal import say
    from servobench.core.rounding import count_text
    from servobench.fleet.page import outcome_text, parameter_text

    now, before = (
        count_text(summary.identified, "file"),
        f", {summary.before} before" if summary.before else "",
    )
    say(console, f"{now} done{before}: {outcome_text(fleet)}")
    if summary.others:
        few = ", ".join(summary.others[:3])
        more = f" and {len(summary.others) - 3} more" if len(summary.others) > 3 else ""
        say(console, f"left out, as their names aren't those of recordings: {few}{more}")
    for parameter in fleet.parameters:
        say(console, parameter_text(fleet, parameter))
    failed = [
        f"{file}: {with_options(reason)}"
        for file, outcome, reason in zip(fleet.files, fleet.outcomes, fleet.reasons, strict=True)
        if outcome != "identified"
    ]
    for line in failed[:_MOST_REASONS]:
        say(console, line)
    if len(failed) > _MOST_REASONS:
        say(console, f"and {len(failed) - _MOST_REASONS} more without a result; motors.csv has the reasons")
    say(console, f"\ntable: {out / 'motors.csv'}, motors.parquet; report: {out / 'report.html'}")


def status_of_fleet(fleet: Fleet) -> int:
    """Return the exit status: with limits by the decisions, without them by the worst file."""
    if fleet.limits is not None:
        decisions = fleet.counts("decisions")
        if decisions.get("fail"):
            return FAILED_LIMITS
        return UNDECIDED if decisions.get("undecided") else DONE
    if any(outcome != "identified" for outcome in fleet.outcomes):
        return USER_MISTAKE
    return REFUSED if "refused" in fleet.verdicts else DONE
