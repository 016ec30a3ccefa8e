"""Columns of which many cells are no numbers."""

from pathlib import Path

import pytest

from servobench.core.errors import FormatError
from servobench.core.finding import Severity
from servobench.recordings.formats.mapping import assign
from tests.recordings.formats.tables import codes, finding, loaded


def table(texts: int, text: str, rows: int = 200, column: str = "y") -> str:
    """Rows of t, u, y and z with a text in place of a number in the last rows of a column."""
    lines = ["t [s];u [V];y [rad];z"]
    for k in range(rows):
        cells = {"t": f"{0.01 * k:.2f}", "u": "1.5", "y": f"{0.1 * k:.4f}", "z": "7"}
        if k >= rows - texts:
            cells[column] = text
        lines.append(";".join(cells.values()))
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize(
    ("texts", "severity"), [(3, Severity.WARNING), (100, Severity.WARNING), (101, Severity.REFUSAL)]
)
def test_many_texts_in_the_output_make_it_doubtful_and_more_than_half_refuse_it(
    texts: int, severity: Severity, tmp_path: Path
) -> None:
    found = finding(assign(loaded(tmp_path, table(texts, "off"))).findings, "column-not-numbers")

    assert found.severity is severity
    assert f"`y` has {texts} cells of 200" in found.sentence
    assert "'off'" in found.sentence


@pytest.mark.parametrize("text", ["-1.003,1836", "1,003.5", "1'003,5", "1.003.183", "1,234"])
def test_separators_between_thousands_are_named(text: str, tmp_path: Path) -> None:
    found = finding(loaded(tmp_path, table(50, text)).findings, "column-not-numbers")

    assert "between thousands" in found.sentence


@pytest.mark.parametrize(("texts", "text"), [(2, "off"), (150, "n/a"), (150, "")])
def test_a_few_texts_and_cells_that_say_that_there_is_nothing_are_no_damage(
    texts: int, text: str, tmp_path: Path
) -> None:
    assert "column-not-numbers" not in codes(loaded(tmp_path, table(texts, text)).findings)


def test_texts_in_a_column_that_nobody_uses_are_only_reported(tmp_path: Path) -> None:
    found = assign(loaded(tmp_path, table(150, "idle", column="z"))).findings

    assert finding(found, "column-not-numbers").severity is Severity.INFO


def test_texts_in_a_column_of_another_file_that_nobody_uses_are_only_reported(tmp_path: Path) -> None:
    (tmp_path / "other.csv").write_text(table(50, "idle", column="z"))
    own = loaded(tmp_path, table(0, ""))

    found = assign(own, input=f"{tmp_path / 'other.csv'}#u:V").findings

    assert finding(found, "column-not-numbers").severity is Severity.INFO


def test_a_column_of_words_alone_is_no_damage(tmp_path: Path) -> None:
    assert "column-not-numbers" not in codes(loaded(tmp_path, table(200, "idle", column="z")).findings)


@pytest.mark.parametrize(
    ("role", "options"),
    [
        ("time", {"time": "z:s"}),
        ("input", {"input": "z:V"}),
        ("output", {"output": "z:rad"}),
    ],
)
def test_a_column_that_cannot_be_read_is_named_with_a_cell_that_is_no_number(
    role: str, options: dict[str, str], tmp_path: Path
) -> None:
    recording = loaded(tmp_path, table(200, "idle", column="z"))

    with pytest.raises(FormatError) as caught:
        assign(recording, **options)  # type: ignore[arg-type]

    assert str(caught.value) == (
        f"log: the {role} can't be read: `z` holds text, such as 'idle', and no number. If another column is the {role}, say "
        f"`{role}=COL:UNIT`"
    )


@pytest.mark.parametrize("texts", [199, 200])
def test_a_time_with_separators_between_thousands_that_are_not_read_says_how_to_write_it(
    texts: int, tmp_path: Path
) -> None:
    recording = loaded(tmp_path, table(texts, "1.003.183", column="z"))

    with pytest.raises(
        FormatError, match=r"the time can't be read: .*'1\.003\.183', .*: write the numbers without them"
    ):
        assign(recording, time="z:us")
