"""Tables of studies as texts: the paper's numbers beside ours, and by how much they are off."""

import math

import pytest

from servobench.core.errors import UnknownName, UsageError
from servobench.lab.studies.base import Column, StudyResult, StudySettings, Table, carry_out
from servobench.lab.table_text import off_by, text_columns

NBSP = "\u00a0"


def table(paper: tuple[float | str, ...] = ()) -> Table:
    words = Column(name="motor", heading="motor", values=("one", "two"))
    numbers = Column(name="tau", heading="τ", unit="ms", values=(99.8, 80.7123), paper=paper, digits=3)
    return Table(title="Two motors", columns=(words, numbers))


@pytest.mark.parametrize(
    ("ours", "paper", "said"),
    [
        (0.0998, 0.13, f"+30{NBSP}%"),  # 0.13/0.0998 - 1 = 0.3026
        (0.00667, 0.006, f"−10{NBSP}%"),
        (0.17578125, 0.175778125, f"−0.0018{NBSP}%"),  # 18 ppm, and no rounding of the right one
        (7.9577, 7.96, f"0{NBSP}%"),  # rounded as the paper has it
        (23.8095, 23.8, f"0{NBSP}%"),
        (50.3, 50, f"0{NBSP}%"),
        (50.6, 50, f"−1.2{NBSP}%"),  # 50/50.6 - 1
        (4.04e-6, 4e-6, f"0{NBSP}%"),
        (-10.0, 7.69, f"−177{NBSP}%"),  # a lost sign: -0.769 - 1
        (2.0, 2.0, f"0{NBSP}%"),
        (0.0, 1.0, ""),
        (1.0, math.nan, ""),
        (1.0, "none", ""),
        ("none", 1.0, ""),
    ],
)
def test_how_far_the_paper_is_off(ours: float | str, paper: float | str, said: str) -> None:
    assert off_by(ours, paper) == said


def test_the_papers_numbers_and_the_difference_have_columns_of_their_own() -> None:
    columns = text_columns(table(paper=(130, "")))

    assert [column.titled for column in columns] == ["motor", "τ [ms]", "paper", "off by"]
    assert [column.kind for column in columns] == ["word", "number", "paper", "off"]
    assert [column.texts for column in columns] == [
        ("one", "two"),
        ("99.8", "80.7"),
        ("130", ""),
        (f"+30{NBSP}%", ""),
    ]


def test_without_numbers_of_the_paper_there_are_ours_alone() -> None:
    assert [column.titled for column in text_columns(table())] == ["motor", "τ [ms]"]


class Asked(StudySettings):
    """A study that shows the table."""

    def __call__(self, stand: object) -> StudyResult:
        return StudyResult(tables=(table(),))


def test_the_papers_numbers_come_from_the_studys_settings() -> None:
    shown = carry_out(Asked(paper={"tau": (130, "")}), None)  # type: ignore[arg-type]

    assert shown.tables[0].columns[1].paper == (130, "")
    with pytest.raises(UnknownName, match="no column called 'taus'"):
        carry_out(Asked(paper={"taus": (130, "")}), None)  # type: ignore[arg-type]
    with pytest.raises(UsageError, match="the paper's numbers for 'tau' are 1, but the table has 2 rows"):
        carry_out(Asked(paper={"tau": (130,)}), None)  # type: ignore[arg-type]
