"""`servobench fleet repeatability`: how much of the scatter the test stand makes itself."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from servobench.cli.options import AsJson, LimitsFile

if TYPE_CHECKING:
    from rich.console import Console

    from servobench.fleet.repeatability import GaugeStudy
    from servobench.fleet.table import Fleet, Parameter

SCHEMA = "servobench.repeatability/1"
_USUAL = ("gain", "time_constant")


def repeatability(
    results: Annotated[Path, typer.Argument(metavar="RESULTS", hidden=True)],
    part: Annotated[
        str, typer.Option(metavar="COLUMN", help="The column that says which motor it was.")
    ] = "serial",
    operator: Annotated[
        str | None,
        typer.Option(
            metavar="COLUMN", help="The column of the operator or the stand; without it, there is only one."
        ),
    ] = None,
    trial: Annotated[
        str | None,
        typer.Option(
            metavar="COLUMN", help="The column that orders the trials; by default the file's name does."
        ),
    ] = None,
    parameter: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME", help="The parameter, by default gain and time_constant; may be repeated."
        ),
    ] = None,
    limits: LimitsFile = None,
    as_json: AsJson = False,
) -> None:
    """Split the scatter in RESULTS of `servobench fleet` into that of the test stand and that of the motors: gauge R&R.

    Each motor must have been recorded several times, equally often by each operator or on each stand; the columns that say which
    come from --pattern '{serial}_{operator}_{trial}.csv'. If --limits has both limits of a parameter, the shares of its tolerance
    are given, too.
    """
    from servobench.cli.terminal import messages, output, print_json
    from servobench.core.errors import UnknownName, UsageError
    from servobench.fleet.limits import Limits
    from servobench.fleet.repeatability import gauge_study, study_values
    from servobench.fleet.table import fleet_in

    fleet = fleet_in(results, Limits.read(limits) if limits is not None else None)
    known = {each.name: each for each in fleet.parameters}
    if not known:
        raise UsageError(
            f"{results}: none of its files has a result to compare; see the reasons in the table"
        )
    studies: dict[str, GaugeStudy] = {}
    for name in parameter or [each for each in _USUAL if each in known] or list(known)[:1]:
        if name not in known:
            raise UnknownName("parameter in these results", name, known)
        values = known[name].value
        used = [number for number, value in enumerate(values) if math.isfinite(value)]
        columns = [_column(fleet, column, used) for column in (part, operator, trial)]
        trials = columns[2] if trial else [fleet.files[number] for number in used]
        y = study_values([float(values[number]) for number in used], columns[0], columns[1], trials)
        studies[name] = gauge_study(y, _tolerance(fleet, known[name]))
    console = messages() if as_json else output()
    for name, study in studies.items():
        _show(console, known[name], study)
    if as_json:
        plain: dict[str, Any] = {
            name: {"unit": known[name].unit, **study.to_dict()} for name, study in studies.items()
        }
        print_json({"schema": SCHEMA, "parameters": plain})


def _column(fleet: Fleet, name: str | None, used: list[int]) -> list[str]:
    """A column from the names of the files, for the rows that are used; the same text in all rows where none is named."""
    from servobench.core.errors import UnknownName

    if name is None:
        return [""] * len(used)
    if name not in fleet.texts:
        raise UnknownName(
            "column", name, fleet.texts, "; the columns come from `pattern='{serial}_{operator}_{trial}.csv'`"
        )
    return [fleet.texts[name][number] for number in used]


def _tolerance(fleet: Fleet, parameter: Parameter) -> float | None:
    """The width between two limits, None where there aren't two."""
    for limit in fleet.limits.limits if fleet.limits else ():
        low, high = limit.ends(parameter.unit) if limit.parameter == parameter.name else (-math.inf, math.inf)
        if math.isfinite(high - low):
            return high - low
    return None


def _show(console: Console, parameter: Parameter, study: GaugeStudy) -> None:
    from servobench.cli.terminal import say
    from servobench.core.parameter_names import parameter_in_words
    from servobench.core.rounding import plain, with_unit

    name = parameter_in_words(parameter.name, parameter.unit)
    say(console, f"{name}: {study.parts} parts × {study.operators} operators × {study.trials} trials")
    for each in study.components.values():
        tolerance = "" if each.of_tolerance is None else f", {plain(each.of_tolerance, 3)} % of the tolerance"
        say(
            console,
            f"  {each.name:16} sd {with_unit(each.sd, parameter.unit, 3)}, {plain(each.contribution, 3)} % of the variance, "
            f"{plain(each.of_study, 3)} % of the study variation{tolerance}",
        )
    pooled = "; the interaction is counted as repeatability, as its p value is above 0.25" * study.pooled
    enough = "enough" if study.categories >= 5 else "too few: 5 are needed"
    say(console, f"  distinct categories: {study.categories}, {enough}{pooled}\n")
