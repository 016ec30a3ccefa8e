"""Pictures out of characters: what is drawn is where it should be, and fits."""

from __future__ import annotations

import numpy as np
import pytest

from servobench.cli.pictures import Pen, histogram, line_over_time

ASCII, BRAILLE = Pen(braille=False), Pen(braille=True)


def test_a_held_step_is_low_and_then_high_with_its_ends_named() -> None:
    t = np.array([0.0, 1.0, 2.0])

    picture = line_over_time(t, np.array([1.0, 3.0, 3.0]), ASCII, width=30, height=3, unit="V", held=True)

    top, middle, bottom, axis = picture
    assert top.startswith("3 V |")
    assert bottom.startswith("  1 |")
    columns = 30 - 3 - 2
    assert top.partition("|")[2] == " " * 12 + "*" * 13 + "" if columns == 25 else False
    assert set(middle.partition("|")[2]) <= {" ", "*"}
    assert bottom.partition("|")[2].startswith("*" * 12)
    assert axis.split() == ["0", "s", "2", "s"]


def test_a_straight_line_rises_from_corner_to_corner_in_dots() -> None:
    picture = line_over_time(np.array([0.0, 1.0]), np.array([0.0, 1.0]), BRAILLE, width=40, height=4)

    rows = [line.partition("│")[2] for line in picture[:4]]
    starts = [len(row) - len(row.lstrip()) for row in rows]
    assert starts == sorted(starts, reverse=True)
    assert rows[3][0] != " "
    assert all(0x2800 < ord(letter) <= 0x28FF for row in rows for letter in row.strip())


@pytest.mark.parametrize("pen", [ASCII, BRAILLE])
def test_a_single_spike_among_many_samples_is_seen(pen: Pen) -> None:
    y = np.zeros(100_000)
    y[70_000] = 1.0

    top = line_over_time(np.arange(100_000.0), y, pen, width=60)[0].partition("│" if pen.braille else "|")[2]

    assert len(top.strip()) == 1


@pytest.mark.parametrize("width", [20, 40, 100, 200])
def test_no_line_is_longer_than_there_is_room(width: int) -> None:
    t = np.linspace(0.0, 10.0, 500)

    picture = line_over_time(t, 1e-3 * np.sin(t), BRAILLE, width=width, unit="rad/s")

    assert picture == [] or max(map(len, picture)) <= width


@pytest.mark.parametrize(
    ("t", "y"),
    [
        (np.array([]), np.array([])),
        (np.array([0.0]), np.array([1.0])),
        (np.zeros(4), np.ones(4)),
        (np.array([0.0, 1.0]), np.array([np.nan, 1.0])),
        (np.array([1.0, 0.0, 2.0]), np.ones(3)),
    ],
)
def test_without_a_line_there_is_no_picture(t: np.ndarray, y: np.ndarray) -> None:
    assert line_over_time(t, y, ASCII, width=60) == []


def test_a_level_that_never_changes_is_a_line() -> None:
    assert len(line_over_time(np.arange(5.0), np.full(5, 2.0), ASCII, width=40)) == 5


def test_what_is_there_at_all_has_a_bar() -> None:
    bars = histogram(np.array([0, 1, 1000, 500]), BRAILLE)

    assert bars[0] == " "
    assert bars[1] == "▁"
    assert bars[2] == "█"
    assert histogram(np.array([0, 1, 1000]), ASCII) == " .@"
