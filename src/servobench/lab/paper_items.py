"""The items of a paper that an exercise repeats: a table, a figure or an equation, and where it appears here."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from servobench.core.settings import Settings


class PaperItem(Settings):
    """One thing that the paper contains, and the exercise's study that has it; without one its run or its text has."""

    part: Annotated[str, Field(min_length=1)]
    """The part of the paper, such as `II.D`; a list of all goes by it."""
    item: Annotated[str, Field(min_length=1)]
    """The item, such as `Table 1-4, time constant by cut-off`."""
    study: str = ""
    """The study that shows it; empty where the exercise's own run or its text does."""
