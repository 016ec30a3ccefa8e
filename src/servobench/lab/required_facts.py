"""Facts that a study can't do without."""

from __future__ import annotations

from servobench.core.errors import UnknownName, UsageError
from servobench.core.parameter_names import parameter_in_words
from servobench.lab.studies.base import Stand
from servobench.rig.motor.parameters import DATA_SHEETS

_SHEET = "sheet_"


def required_fact(stand: Stand, name: str) -> float:
    """Return the value of a fact of a stand, in SI units.

    Raises `UsageError` for one of a data sheet where the experiment names none, and `UnknownName` for any other that isn't there.
    """
    if name.startswith(_SHEET) and not stand.experiment.nominal:
        sheets = " or ".join(f'"{sheet}"' for sheet in DATA_SHEETS)
        raise UsageError(
            f"this takes the {parameter_in_words(name.removeprefix(_SHEET))} of a data sheet, and the experiment names none; add "
            f"nominal = {sheets} to the table [experiment]"
        )
    if name not in stand.facts:
        raise UnknownName("fact", name, stand.facts)
    return stand.facts[name].value
