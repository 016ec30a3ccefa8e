"""Rows of a text in which names or units stand beside the values."""

from pathlib import Path

import pytest

from servobench.core.errors import FormatError
from tests.recordings.formats.tables import codes, columns, finding, loaded, units

NUMBERS = {"target": [5.0, 5.0, 7.5], "speed": [0.0, -2.25, 3.5]}

NOTATIONS = {
    "serial plotter": "target:5,speed:0.00\ntarget:5,speed:-2.25\ntarget:7.5,speed:3.5\n",
    "blanks": "target: 5  speed: 0.00\ntarget: 5  speed: -2.25\ntarget: 7.5  speed: 3.5\n",
    "one blank": "target=5 speed=0.00\ntarget=5 speed=-2.25\ntarget=7.5 speed=3.5\n",
    "equals": "target = 5, speed = 0.00\ntarget = 5, speed = -2.25\ntarget = 7.5, speed = 3.5\n",
    "tab": "target:5\tspeed:0.00\ntarget:5\tspeed:-2.25\ntarget:7.5\tspeed:3.5\n",
    "decimal comma": "target: 5; speed: 0,00\ntarget: 5; speed: -2,25\ntarget: 7,5; speed: 3,5\n",
    "decimal comma and comma": "target: 5,0, speed: 0,00\ntarget: 5,0, speed: -2,25\ntarget: 7,5, speed: 3,5\n",
    "dictionaries": "{'target': 5, 'speed': 0.0}\n{'target': 5, 'speed': -2.25}\n{'target': 7.5, 'speed': 3.5}\n",
    "names and values in turn": "target,5,speed,0.00\ntarget,5,speed,-2.25\ntarget,7.5,speed,3.5\n",
    "a log of PuTTY": "=~=~= PuTTY log 2026.11.29 =~=~=\ntarget,5,speed,0\ntarget,5,speed,-2.25\ntarget,7.5,speed,3.5\n",
    "prose above names in turn": "start of run\ntarget,5,speed,0\ntarget,5,speed,-2.25\ntarget,7.5,speed,3.5\n",
    "text above": "ready, 3 loops\n\ntarget:5,speed:0\ntarget:5,speed:-2.25\ntarget:7.5,speed:3.5\n",
}


@pytest.mark.parametrize(
    "head", ["way,speed,side,angle", '"way","speed","side","angle"', "1st way,speed,2nd side,angle"]
)
def test_words_below_names_are_columns_of_words(head: str, tmp_path: Path) -> None:
    text = head + "\n" + "".join(f"fwd,{n}.5,left,{2 * n}\n" for n in range(5))

    recording = loaded(tmp_path, text, "log.csv")

    assert columns(recording)["speed"] == [0.5, 1.5, 2.5, 3.5, 4.5]
    assert columns(recording)["angle"] == [0.0, 2.0, 4.0, 6.0, 8.0]


def test_words_that_change_are_no_names(tmp_path: Path) -> None:
    text = "".join(f"{'run' if n % 3 else 'stop'},{n}.5,auto,{2 * n}\n" for n in range(12))

    assert "run" not in columns(loaded(tmp_path, text, "log.csv"))


@pytest.mark.parametrize("notation", NOTATIONS)
def test_rows_that_name_their_values_are_a_table_with_these_names(notation: str, tmp_path: Path) -> None:
    recording = loaded(tmp_path, NOTATIONS[notation], "log.txt")

    assert columns(recording) == NUMBERS
    assert "`target`, `speed`" in finding(recording.findings, "labelled-values").sentence


def test_the_time_among_named_values_is_the_time(tmp_path: Path) -> None:
    recording = loaded(tmp_path, "t_ms=0, u=1\nt_ms=20, u=2\nt_ms=40, u=3\n", "log.txt")

    assert recording["u"].t is not None
    assert recording["u"].t.tolist() == [0.0, 0.02, 0.04]


def test_units_behind_numbers_are_those_of_the_columns(tmp_path: Path) -> None:
    labelled = loaded(tmp_path, "u: 1.5 V, n: 30rpm\nu: 2 V, n: 40rpm\nu: 2 V, n: 45rpm\n", "log.txt")
    bare = loaded(tmp_path, "0.00s, 1.5V, 30rpm\n0.01s, 2V, 40rpm\n0.02s, 2V, 45rpm\n", "log.txt")
    named = loaded(tmp_path, "t,u,n\n0.00s, 1.5V, 30rpm\n0.01s, 2V, 40rpm\n0.02s, 2V, 45rpm\n", "log.txt")

    assert units(labelled) == {"u": "V", "n": "rpm"}
    assert units(bare) == {"column_1": "s", "column_2": "V", "column_3": "rpm"}
    assert units(named) == {"t": "s", "u": "V", "n": "rpm"}
    assert columns(named)["n"] == [30.0, 40.0, 45.0]


def test_a_unit_before_the_next_name_belongs_to_the_value_before_it(tmp_path: Path) -> None:
    spaced = loaded(tmp_path, "".join(f"t={20 * k} ms pwm=10 n={k} rpm\n" for k in range(3)), "log.txt")
    letter = loaded(tmp_path, "t=0 V in=3\nt=1 V in=4\nt=2 V in=4\n", "other.txt")

    assert spaced["pwm"].t is not None
    assert spaced["pwm"].t.tolist() == [0.0, 0.02, 0.04]
    assert units(spaced)["n"] == "rpm"
    assert "V in" in columns(letter)


def test_a_unit_that_changes_from_row_to_row_is_never_dropped(tmp_path: Path) -> None:
    rows = "".join(f"u=2V, y={k}{'mm' if k < 5 else 'm'}\n" for k in range(10))

    recording = loaded(tmp_path, rows, "log.txt")

    assert units(recording)["u"] == "V"
    assert "`y` holds text, such as '0mm'" in finding(recording.findings, "column-skipped").sentence


def test_a_damaged_row_costs_itself_and_a_row_of_other_names_is_never_mixed_in(tmp_path: Path) -> None:
    rows = [f"u:{k},y:{2 * k}\n" for k in range(10)]
    rows[4], rows[7] = "u:4,y\n", "y:1,u:2\n"

    recording = loaded(tmp_path, "".join(rows), "log.txt")

    assert columns(recording)["u"] == [0.0, 1.0, 2.0, 3.0, 5.0, 6.0, 8.0, 9.0]
    assert finding(recording.findings, "row-short").rows == (5, 8)


@pytest.mark.parametrize(
    "text",
    [
        "mass: 0.5\nlength: 0.1\ncolour: red\n",  # settings, and no samples
        "a:1,2,b:3\na:4,5,b:6\n",  # 1.2, or 1 and 2
        "u:1\ny:2\nu:3\ny:4\n",
    ],
)
def test_values_without_the_same_names_in_most_rows_are_no_labelled_table(text: str, tmp_path: Path) -> None:
    try:
        recording = loaded(tmp_path, text, "log.txt")
    except FormatError:
        return
    assert "labelled-values" not in codes(recording.findings)
