"""The report of an ensemble: bands over time, the spread of what matters, which tolerance makes it; and its table as CSV."""

from __future__ import annotations

import csv
import io
import math
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from servobench._version import __version__
from servobench.core.channels import Array
from servobench.core.errors import StorageError
from servobench.core.finding import list_text
from servobench.core.parameter_names import parameter_in_words
from servobench.core.rounding import SPACE, count_text, handy_unit, plain, with_unit
from servobench.fleet.ensemble import UNITS as JUDGED_UNITS
from servobench.fleet.ensemble import Coverage, IdentifiedMotor, coverages
from servobench.fleet.ensemble_figures import SHOWN_IN, bands_over_time, spreads, tornado
from servobench.rig.ensemble.ensemble import QUANTILES, Ensemble
from servobench.rig.ensemble.outcomes import UNITS
from servobench.rig.ensemble.sensitivity import Sensitivity

_LITTLE = 1e-3  # of the value; a tolerance that moves it by less isn't worth a word
_ROUGH = 0.2  # by which the lines of the tolerances may miss the variance before that is told


def write_page_of(ensemble: Ensemble, motors: Sequence[IdentifiedMotor], folder: Path, command: str) -> Path:
    """Write `report.html` of an ensemble into a folder and return its path; raises `StorageError` where it can't be written."""
    from servobench.report.document import write_page

    page = folder / "report.html"
    write_page(html_of(ensemble, motors, command), page)
    return page


def html_of(ensemble: Ensemble, motors: Sequence[IdentifiedMotor], command: str) -> str:
    """Return the page as a text; `motors` are the motors that were identified."""
    from servobench.report.html import single, source, template

    spread = spreads(ensemble)
    sections = [
        (
            parameter_in_words(name),
            name.replace("_", "-"),
            [single(each) for each in (spread.get(name), tornado(ensemble, name)) if each],
            remark(ensemble, name),
            [share_row(ensemble, each) for each in ensemble.sensitivities if each.outcome == name],
        )
        for name in ensemble.outcomes
        if name in spread or tornado(ensemble, name)
    ]
    text = template("ensemble.html.j2").render(
        style=source("style.css"),
        version=__version__,
        title=ensemble.experiment.name or "Ensemble",
        total=count_text(len(ensemble), "motor"),
        tolerances=[str(each) for each in ensemble.tolerances],
        sentences=sentences(ensemble),
        outcomes=[outcome_row(ensemble, name) for name in ensemble.outcomes],
        bands=[single(each) for each in bands_over_time(ensemble)],
        drawn=sections,
        coverages=[coverage_text(each) for each in coverages(ensemble, motors)],
        verdicts=Counter(each.verdict or "unusable" for each in motors).most_common(),
        identified=count_text(len(motors), "motor"),
        seed=ensemble.seed,
        command=command,
    )
    return text.encode("utf-8", "replace").decode("utf-8")


def sentences(ensemble: Ensemble) -> list[str]:
    """Return for each tolerance in a sentence what it does: ±5 % of the resistance moves the time constant by ±5 %."""
    lines = []
    for tolerance in ensemble.tolerances:
        of = {each.outcome: each for each in ensemble.sensitivities if each.parameter == tolerance.name}
        moved = [
            f"the {parameter_in_words(name)} by {effect_text(each, ensemble.nominal[name])}"
            for name, each in of.items()
            if _is_worth_a_word(each, ensemble.nominal[name])
        ]
        half = (
            f"±{plain(100 * tolerance.relative, 3)}{SPACE}%"
            if tolerance.value
            else f"±{with_unit(tolerance.half, tolerance.unit, 3)}"
        )
        what = f"{half} of the {parameter_in_words(tolerance.name)}"
        lines.append(
            f"{what} moves {list_text(moved)}."
            if moved
            else f"{what} moves none of these by as much as 0.1 %."
        )
    return lines


def effect_text(each: Sensitivity, nominal: float) -> str:
    """Return by how much an outcome is moved, with ∓ where more of the parameter makes less of it."""
    sign, effect = "∓" if each.effect < 0 else "±", abs(each.effect)
    if not math.isfinite(effect):
        return "an unknown amount"
    if effect == 0:
        return "nothing"
    if each.outcome == "overshoot":
        return f"{sign}{plain(100 * effect, 2)}{SPACE}percentage points"
    if each.outcome == "phase_margin":
        return f"{sign}{plain(math.degrees(effect), 2)}°"
    return f"{sign}{plain(100 * effect / abs(nominal), 2)}{SPACE}%"


def value_text(ensemble: Ensemble, name: str, value: float) -> str:
    """Return a value of an outcome as people write it: an overshoot in per cent, a phase in degrees, all of one in one unit."""
    if not math.isfinite(value):
        return "none"
    factor, unit = SHOWN_IN.get(name, (1.0, UNITS[name]))
    usual = ensemble.nominal[name] if math.isfinite(ensemble.nominal[name]) else value
    handy, symbol = handy_unit(unit, abs(factor * usual))
    return f"{plain(factor * value / handy)}{'' if symbol == '°' else SPACE}{symbol}"


def outcome_row(ensemble: Ensemble, name: str) -> tuple[str, ...]:
    """Return an outcome's name, its nominal value, its quantiles 5, 50 and 95 %, and how many motors have one."""
    values = ensemble.outcomes[name]
    known = values[np.isfinite(values)]
    at = np.quantile(known, (QUANTILES[0], 0.5, QUANTILES[-1])) if len(known) else np.full(3, math.nan)
    return (
        parameter_in_words(name),
        value_text(ensemble, name, ensemble.nominal[name]),
        *(value_text(ensemble, name, float(each)) for each in at),
        str(len(known)),
    )


def share_row(ensemble: Ensemble, each: Sensitivity) -> tuple[str, ...]:
    """Return a parameter, the outcome at both ends of its tolerance, the effect, and the share of the outcome's variance."""
    return (
        parameter_in_words(each.parameter),
        value_text(ensemble, each.outcome, each.low),
        value_text(ensemble, each.outcome, each.high),
        effect_text(each, ensemble.nominal[each.outcome]),
        f"{plain(100 * each.share, 2)}{SPACE}%" if math.isfinite(each.share) else "",
    )


def remark(ensemble: Ensemble, name: str) -> str:
    """Return what to know about an outcome's shares: that they are rough, or how many motors have none; empty for nothing."""
    values, by_lines = ensemble.outcomes[name], ensemble.linear_share(name)
    lacking = int((~np.isfinite(values)).sum())
    text = f"{count_text(lacking, 'motor')} {'has' if lacking == 1 else 'have'} none. " if lacking else ""
    if lacking and name == "settling_time":
        text = f"{count_text(lacking, 'motor')} didn't settle within the experiment. "
    if math.isfinite(by_lines) and abs(by_lines - 1) > _ROUGH and len(values) > 100:
        text += f"Straight lines explain {plain(100 * by_lines, 2)} % of the variance among these motors: the shares are rough."
    return text.strip()


def coverage_text(each: Coverage) -> str:
    """Return in a sentence how often the intervals of a parameter hold the truth."""
    return (
        f"{parameter_in_words(each.parameter)}: {each.covered} of {count_text(each.known, 'interval')} "
        f"{'contains' if each.known == 1 else 'contain'} the true value "
        f"({plain(100 * each.share, 3)}{SPACE}%); expected 95{SPACE}% ± {plain(196 * each.sd, 2)}{SPACE}%"
    )


def write_table(ensemble: Ensemble, motors: Sequence[IdentifiedMotor], folder: Path) -> Path:
    """Write `motors.csv`, a row for each motor in SI units, and return its path; raises `StorageError` where it can't be."""
    columns: dict[str, Array] = {
        "motor": np.arange(len(ensemble), dtype=np.float64),
        **ensemble.parameters,
        **ensemble.outcomes,
        "final_speed": ensemble.final[1],
        "final_position": ensemble.final[2],
    }
    identified = {each.number: each for each in motors}
    names = [name for name in JUDGED_UNITS if any(name in each.values for each in motors)]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    more = [f"identified_{name}{end}" for name in names for end in ("", "_sd", "_low", "_high")]
    writer.writerow([*columns, *(["verdict", "reason", *more] if motors else [])])
    for number, row in enumerate(zip(*(values.tolist() for values in columns.values()), strict=True)):
        cells: list[object] = [number, *("" if not math.isfinite(x) else x for x in row[1:])]
        if motors:
            one = identified.get(number)
            cells += [one.verdict, one.reason] if one else ["", ""]
            for name in names:
                cells += one.values.get(name, [""] * 4) if one else [""] * 4
        writer.writerow(cells)
    path = folder / "motors.csv"
    try:
        path.write_text(text.getvalue(), encoding="utf-8")
    except OSError as error:
        raise StorageError(f"{path} can't be written: {error.strerror or error}") from error
    return path


def _is_worth_a_word(each: Sensitivity, nominal: float) -> bool:
    size = 1.0 if each.outcome in ("overshoot", "phase_margin") else abs(nominal)
    return math.isfinite(each.effect) and math.isfinite(nominal) and abs(each.effect) >= _LITTLE * size
