"""Lines from a wire become rows, and what is no row is counted."""

import numpy as np
import pytest

from servobench.recordings.streams.line_table import LineTable


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("t,u,counts\n0,1.5,7\n", ("t", "u", "counts")),
        ("0,1.5,7\n", ("column_1", "column_2", "column_3")),
        ("rig ready\nt [ms]\tu [V]\tcounts\n0\t1.5\t7\n", ("t [ms]", "u [V]", "counts")),
        ("0 1.5 7\r\n", ("column_1", "column_2", "column_3")),
        ("t;u;counts\n0;1,5;7\n", ("t", "u", "counts")),
        ("t\tu\tcounts\r\n0,0\t1,5\t7\r\n", ("t", "u", "counts")),
        ("t:0,u:1.5,counts:7\n", ("t", "u", "counts")),
        ("t:0 u:1.5 counts:7\n", ("t", "u", "counts")),
    ],
)
def test_a_line_is_a_row_whatever_separates_its_fields(text: str, names: tuple[str, ...]) -> None:
    table = LineTable()
    rows = table.take(text.encode() + text.splitlines(keepends=True)[-1].encode())

    assert rows.names == names
    assert rows.values.tolist() == [[0.0, 1.5, 7.0]] * 2
    assert rows.damaged == 0


def test_bytes_may_come_in_any_pieces() -> None:
    text = b"t,u,counts\r\n" + b"".join(b"%d,1.5,%d\r\n" % (k, 3 * k) for k in range(50))
    table = LineTable()

    rows = np.concatenate([table.take(text[k : k + 1]).values.reshape(-1, 3) for k in range(len(text))])

    assert rows[:, 2].tolist() == [3.0 * k for k in range(50)]


def test_damaged_lines_are_counted_and_shown() -> None:
    rows = LineTable().take(b"t,u,counts\n0,1,2\n1,1\n2,\xff,2\n3,nan,2\n4,1,2,5\n5,1,2\n")

    assert rows.values[:, 0].tolist() == [0.0, 5.0]
    assert rows.damaged == 4
    assert rows.example == "1,1"


def test_a_header_that_is_printed_again_is_no_damage() -> None:
    assert LineTable().take(b"t,u\n0,1\nt,u\n1,1\n").damaged == 0


def test_a_first_line_that_may_be_torn_is_left_out_unless_it_is_no_row() -> None:
    assert LineTable(torn=True).take(b"34,1,2\n5,1,2\n6,1,2\n").values[:, 0].tolist() == [5.0, 6.0]
    assert LineTable(torn=True).take(b"t,u,counts\n5,1,2\n").values[:, 0].tolist() == [5.0]


def test_a_line_without_an_end_does_not_grow_for_ever() -> None:
    table = LineTable()
    table.take(b"t,u\n0,1\n")

    assert table.take(b"7" * 5000).damaged == 1
    assert table.take(b"\n2,1\n").values.tolist() == [[2.0, 1.0]]


@pytest.mark.parametrize("part", ["3,17", "7", "0.002,3,17", "4,3,17"])
def test_the_end_of_a_line_that_began_before_does_not_decide_how_many_columns_there_are(part: str) -> None:
    table = LineTable(torn=True)
    rows = table.take(f"{part}\n0.004,3,18\n0.006,3,19\n".encode())

    assert rows.values.tolist() == [[0.004, 3, 18], [0.006, 3, 19]]
    assert rows.damaged == 0


def test_a_header_is_a_whole_line_even_if_it_comes_first() -> None:
    rows = LineTable(torn=True).take(b"t,u,counts\n0.004,3,18\n")

    assert rows.names == ("t", "u", "counts")
    assert rows.values.tolist() == [[0.004, 3, 18]]


def test_before_the_first_row_the_last_line_is_shown_and_no_damage() -> None:
    table = LineTable()

    assert [(rows.damaged, rows.example) for rows in [table.take(b"rig ready\n"), table.take(b"t,u\n")]] == [
        (0, "rig ready"),
        (0, "t,u"),
    ]
    assert table.take(b"0,1\n1,2\n").example == ""


def test_the_mark_that_windows_programs_put_before_a_text_is_no_part_of_the_first_name() -> None:
    table = LineTable()

    assert table.take("\ufefft,u,counts\r\n0.1,2,3\r\n".encode()).names == ("t", "u", "counts")


@pytest.mark.parametrize(
    ("text", "names", "damaged"),
    [
        ("500,31\nt,u,counts\n0,1,2\n1,1,3\n", ("t", "u", "counts"), "500,31"),
        ("500,31\n0,1,2\n1,1,3\n", ("column_1", "column_2", "column_3"), "500,31"),
        (".2,500,31\nt,u,counts\n0,1,2\n1,1,3\n", ("t", "u", "counts"), ".2,500,31"),
        ("t,u,counts\n500,31\n0,1,2\n1,1,3\n", ("t", "u", "counts"), "500,31"),
        ("7,8\n9,9,9,9\n0,1,2\n1,1,3\n", ("column_1", "column_2", "column_3"), "7,8"),
    ],
)
def test_a_stray_row_at_the_beginning_decides_nothing_and_is_counted(
    text: str, names: tuple[str, ...], damaged: str
) -> None:
    rows = LineTable().take(text.encode())

    assert rows.names == names
    assert rows.values.tolist() == [[0.0, 1.0, 2.0], [1.0, 1.0, 3.0]]
    assert rows.damaged == (2 if text.startswith("7") else 1)
    assert rows.example == damaged


def test_a_single_row_without_a_header_is_one_at_the_end() -> None:
    table = LineTable()

    assert table.take(b"0,1.5,7\n").values.size == 0
    assert table.end().values.tolist() == [[0.0, 1.5, 7.0]]
