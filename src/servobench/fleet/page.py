"""The report of a fleet: one page that opens from disk, of the same size for a hundred motors and for twenty thousand."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from servobench._version import __version__
from servobench.core.channels import Array
from servobench.core.errors import ServobenchError
from servobench.core.parameter_names import parameter_in_words
from servobench.core.rounding import count_text, plain, with_unit
from servobench.fleet.decision import Decision, GlobalRisks, global_risks
from servobench.fleet.figures import distribution, over_time
from servobench.fleet.outliers import farthest_plain
from servobench.fleet.row import IDENTIFIED
from servobench.fleet.settings import Settings
from servobench.fleet.source import Item, source_at
from servobench.fleet.table import Fleet, Parameter
from servobench.fleet.worker import write_report

WORST = 10
"""The largest number of motors that the report lists, with a report of each."""
_MOST = 20  # lines of a table of reasons or findings
_MAD = 1.482602218505602


@dataclass(frozen=True, kw_only=True)
class WorstMotor:
    """A motor that somebody should look at: why, what may be the cause, and its report below the page, if it could be written."""

    file: str
    """Its recording."""
    why: str
    cause: str
    report: str


def write_page_of(fleet: Fleet, place: str, folder: Path, settings: Settings, command: str) -> Path:
    """Write `report.html` of a fleet into the folder of its results, and the reports of the worst ten; return its path.

    Raises `StorageError` where it can't be written.
    """
    from servobench.report.document import write_page

    page = folder / "report.html"
    write_page(html_of(fleet, place, worst_motors(fleet, place, folder, settings, command), command), page)
    return page


def html_of(fleet: Fleet, place: str, worst: tuple[WorstMotor, ...], command: str) -> str:
    """Return the page as a text."""
    from servobench.report.html import single, source, template

    order, along = order_of(fleet)
    sections = [
        (
            parameter_in_words(each.name, each.unit),
            each.name.replace("_", "-"),
            [
                figure
                for figure in (
                    single(distribution(fleet, each)),
                    single(over_time(fleet, each, order, along)),
                )
                if figure
            ],
        )
        for each in fleet.parameters
        if np.isfinite(each.value).any()
    ]
    decisions, outcomes, verdicts = (fleet.counts(what) for what in ("decisions", "outcomes", "verdicts"))
    failed = Counter(
        reason for outcome, reason in zip(fleet.outcomes, fleet.reasons, strict=True) if outcome != IDENTIFIED
    )
    examples = {reason: file for file, reason in zip(fleet.files, fleet.reasons, strict=True)}
    text = template("fleet.html.j2").render(
        style=source("style.css"),
        version=__version__,
        title=place,
        state=_state(fleet),
        reason=outcome_text(fleet),
        counts=[
            (name, count) for counter in (decisions, outcomes, verdicts) for name, count in counter.items()
        ],
        rule=fleet.limits.rule if fleet.limits else None,
        parameters=[_parameter_row(fleet, each) for each in fleet.parameters],
        drawn=sections,
        outliers=_outlier_text(fleet),
        worst=worst,
        failed=[(reason, count, examples[reason]) for reason, count in failed.most_common(_MOST)],
        more_failed=max(0, len(failed) - _MOST),
        findings=list(fleet.findings.items())[:_MOST],
        total=len(fleet.files),
        seconds=plain(fleet.cpu_seconds / max(len(fleet.files), 1), 2),
        command=command,
    )
    return text.encode("utf-8", "replace").decode("utf-8")


def worst_motors(
    fleet: Fleet, place: str, folder: Path, settings: Settings, command: str
) -> tuple[WorstMotor, ...]:
    """Return the ten motors that most need a look, those that fail first, then by distance; `reports` has their reports."""
    reports = folder / "reports"
    reports.mkdir(exist_ok=True)
    before = set(reports.glob("*.html"))
    source = source_at(place, without=folder)
    middle = _middle(fleet)
    motors = []
    for number in _worst_first(fleet)[:WORST]:
        file = fleet.files[number]
        item = Item(file, fleet.stamps[number])
        page = reports / _page_name(item)
        try:
            claimed = {name: middle[name] for name in _odd(fleet, number) & set(middle)}
            cause = " ".join(write_report(source, settings, item, claimed, page, command))
        except (ServobenchError, OSError) as error:  # it was readable once; the row stays
            cause = f"no report: {error}"
        link = f"reports/{page.name}" if page.exists() else ""
        motors.append(WorstMotor(file=file, why=_why(fleet, number), cause=cause, report=link))
    for old in before - {folder / each.report for each in motors}:
        old.unlink()
    return tuple(motors)


def _page_name(item: Item) -> str:
    """The file name of a recording's report: after its file, and another one once the file has changed."""
    stem = re.sub(r"[^\w.-]", "_", Path(item.name).stem)[:80]
    return f"{stem}-{sha256(f'{item.name} {item.stamp}'.encode()).hexdigest()[:8]}.html"


def order_of(fleet: Fleet) -> tuple[Array, str]:
    """Return the motors in the order in which they were made, and by what: `date`, `time` and `serial`, or their names."""
    columns = [name for name in ("date", "time", "serial") if name in fleet.texts]
    keys = [
        tuple(fleet.texts[name][number] for name in columns) or (file,)
        for number, file in enumerate(fleet.files)
    ]
    order = sorted(range(len(keys)), key=lambda number: [_natural(part) for part in keys[number]])
    return np.array(order, dtype=np.intp), " and ".join(columns) or "name"


def outcome_text(fleet: Fleet) -> str:
    """Return in a line what came of all motors."""
    total = count_text(len(fleet.files), "motor")
    if fleet.limits is not None:
        decisions = fleet.counts("decisions")
        counts_text = ", ".join(f"{decisions.get(each, 0)} {each}" for each in ("pass", "fail", "undecided"))
        return f"{total}: {counts_text}, by the rule {fleet.limits.rule.name}"
    verdicts, outcomes = fleet.counts("verdicts"), fleet.counts("outcomes")
    parts = [f"{verdicts[each]} {each}" for each in ("trusted", "doubtful", "refused") if each in verdicts]
    parts += [f"{outcomes[each]} {each}" for each in ("unusable", "crashed") if each in outcomes]
    return f"{total}: {', '.join(parts)}"


def parameter_text(fleet: Fleet, parameter: Parameter) -> str:
    """Return in a line how a parameter is spread, and its risks where it has limits."""
    row = _parameter_row(fleet, parameter)
    risks = f"; {row['risks']}" if row["risks"] else ""
    return f"{row['name']}: median {row['median']}, robust sd {row['spread']}, {row['from']} to {row['to']}{risks}"


def risks_of(fleet: Fleet, parameter: Parameter) -> GlobalRisks | None:
    """Return the risks of the rule for a production like this fleet; None without limits of the parameter.

    The true values are taken as normal about the median, with the robust variance of the values less that of their uncertainty.
    """
    values, u = parameter.value, parameter.u
    used = np.isfinite(values)
    if fleet.limits is None or used.sum() < 8:
        return None
    for limit in fleet.limits.limits:
        if limit.parameter == parameter.name:
            typical = float(np.median(u[used]))
            spread = np.sqrt(max(_robust_sd(values[used]) ** 2 - typical**2, 0.0))
            ends = limit.ends(parameter.unit)
            return global_risks(
                float(np.median(values[used])), float(spread), typical, *ends, fleet.limits.rule
            )
    return None


def _robust_sd(values: Array) -> float:
    return _MAD * float(np.median(np.abs(values - np.median(values))))


def _parameter_row(fleet: Fleet, parameter: Parameter) -> dict[str, str]:
    values = parameter.value[np.isfinite(parameter.value)]
    if not len(values):
        return dict.fromkeys(("name", "known", "median", "spread", "from", "to", "risks"), "")
    risks = risks_of(fleet, parameter)
    unit = parameter.unit
    return {
        "name": parameter_in_words(parameter.name, unit),
        "known": str(len(values)),
        "median": with_unit(float(np.median(values)), unit),
        "spread": with_unit(_robust_sd(values), unit, 2),
        "from": with_unit(float(values.min()), unit),
        "to": with_unit(float(values.max()), unit),
        "risks": _risk_text(risks) if risks else "",
    }


def _risk_text(risks: GlobalRisks) -> str:
    return (
        f"of all motors {_share(risks.consumer)} are outside and pass (consumer's risk), {_share(risks.producer)} within and "
        f"fail (producer's risk), {_share(risks.undecided)} undecided"
    )


def _share(probability: float) -> str:
    return "less than 0.001 %" if probability < 1e-5 else f"{plain(100 * probability, 2)} %"


def _state(fleet: Fleet) -> str:
    """The colour of the page's first line."""
    if fleet.limits is not None:
        decisions = fleet.counts("decisions")
        return "refused" if decisions.get("fail") else "doubtful" if decisions.get("undecided") else "trusted"
    return "trusted" if set(fleet.verdicts) == {"trusted"} else "doubtful"


def _outlier_text(fleet: Fleet) -> str:
    known = int(np.isfinite(fleet.distance).sum())
    if not known:
        return "Too few motors with the same parameters known to say which are unlike the others."
    motors = count_text(int(fleet.outlying.sum()), "motor")
    return (
        f"{motors} of {known} further than {plain(fleet.farthest, 3)} standard deviations from the middle of all, over all "
        "parameters together; one fleet in a hundred of identical motors has one"
    )


def _worst_first(fleet: Fleet) -> list[int]:
    """The motors with a result, those that fail first, the farthest first."""
    usable = [number for number, outcome in enumerate(fleet.outcomes) if outcome == IDENTIFIED]
    distance = np.nan_to_num(fleet.distance, nan=0.0)
    return sorted(
        usable, key=lambda number: (not _fails(fleet, number), -distance[number], fleet.files[number])
    )


def _fails(fleet: Fleet, number: int) -> bool:
    return bool(fleet.judgements) and fleet.judgements[number].decision is Decision.FAIL


def _why(fleet: Fleet, number: int) -> str:
    parts = [fleet.verdicts[number]]
    if fleet.judgements:
        judged = fleet.judgements[number]
        parts += [str(judged.decision), judged.decided_by]
    parts += [
        f"{parameter_in_words(each.name, each.unit)} {with_unit(float(each.value[number]), each.unit)} where the median is "
        f"{with_unit(float(np.nanmedian(each.value)), each.unit)}"
        for each in fleet.parameters
        if each.name in _odd(fleet, number)
    ]
    if np.isfinite(fleet.distance[number]):
        parts.append(f"distance {plain(float(fleet.distance[number]), 3)}")
    return "; ".join(filter(None, parts))


def _odd(fleet: Fleet, number: int) -> set[str]:
    """The parameters that by themselves are further from the median than that of any motor in 99 of 100 plain fleets."""
    names = set()
    for each in fleet.parameters:
        values = each.value[np.isfinite(each.value)]
        if np.isfinite(each.value[number]) and len(values) >= 8:
            reach = farthest_plain(len(values), 1) * float(np.hypot(_robust_sd(values), each.u[number]))
            if abs(each.value[number] - np.median(values)) > reach:
                names.add(each.name)
    return names


def _middle(fleet: Fleet) -> Mapping[str, float]:
    """The fleet's typical gain and time constant, which an odd motor is compared with."""
    return {
        each.name: float(np.nanmedian(each.value))
        for each in fleet.parameters
        if each.name in ("gain", "time_constant") and np.isfinite(each.value).any()
    }


def _natural(text: str) -> tuple[Any, ...]:
    """A text in the order in which people count: `motor 9` before `motor 10`."""
    return tuple(
        (0, int(part), "") if part.isdecimal() else (1, 0, part) for part in re.split(r"(\d+)", text) if part
    )
