"""Exercises as files: what a lecturer writes, and what is said of mistakes in it."""

from pathlib import Path

import pytest

from servobench.errors import FormatError, UnknownName, UsageError
from servobench.lab.exercise import exercise, exercises, load_exercise, read_exercise

GOOD = """+++
title = "Mine"
order = 3

[experiment]
duration = "2 s"

[signal]
type = "step"

[[blanks]]
id = "gain"
label = "Gain"
unit = "rad/(s·V)"
answer = "read_gain"
tolerance = "5 %"

[[blanks]]
id = "other"
label = "Other"
answer = "1"
tolerance = "exact"
+++

# What to do

Nothing +++ but this.
"""


def read(text: str) -> object:
    return read_exercise(text, "mine", "mine.md")


def test_a_file_is_an_exercise_without_a_line_of_python(tmp_path: Path) -> None:
    (tmp_path / "mine.md").write_text(GOOD, encoding="utf-8")

    [found] = exercises(tmp_path)

    assert (found.name, found.title, found.order) == ("mine", "Mine", 3)
    assert found.experiment.duration == 2.0
    assert [blank.id for blank in found.blanks] == ["gain", "other"]
    assert found.lines == (11, 18)
    assert found.text == "# What to do\n\nNothing +++ but this.\n"


def test_lines_may_end_as_windows_ends_them_and_a_byte_order_mark_does_no_harm(tmp_path: Path) -> None:
    (tmp_path / "mine.md").write_bytes(b"\xef\xbb\xbf" + GOOD.replace("\n", "\r\n").encode())

    assert load_exercise(tmp_path / "mine.md").lines == (11, 18)


def test_a_file_that_was_changed_is_read_again(tmp_path: Path) -> None:
    import os

    path = tmp_path / "mine.md"
    path.write_text(GOOD, encoding="utf-8")
    first = exercise("mine", tmp_path)
    assert exercise("mine", tmp_path) is first

    path.write_text(GOOD.replace('"Mine"', '"Yours"'), encoding="utf-8")
    os.utime(path, ns=(0, 12345))

    assert exercise("mine", tmp_path).title == "Yours"


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("+++\ntitle", "title", r"mine\.md:1: expected a line `\+\+\+`"),
        ('"exact"\n+++', '"exact"', r"mine\.md:27: the TOML isn't ended"),
        ('title = "Mine"', "title = Mine", r"mine\.md:2: this is no TOML"),
        ('title = "Mine"', 'titel = "Mine"', r"mine\.md: title: is missing"),
        ('type = "step"', 'type = "stepp"', r"mine\.md:9: signal\.type: no signal called 'stepp'"),
        ('duration = "2 s"', 'duration = "2 V"', r"mine\.md:6: .*'2 V' is a voltage"),
        ('id = "gain"', 'id = "Gain!"', r"mine\.md:12: blanks\[0\]\.id"),
        ('id = "other"', 'id = "gain"', r"mine\.md:18: two blanks have the id 'gain', the other in line 11"),
        ('answer = "read_gain"', 'answer = "import os"', r"mine\.md:11: blanks\[0\]: .*is no expression"),
        ('tolerance = "5 %"', 'tolerance = "5 V"', r"mine\.md:11: blanks\[0\]: .*tolerance"),
        ('unit = "rad/(s·V)"', 'unit = "furlongs"', r"mine\.md:11: blanks\[0\]: .*furlongs"),
        ('unit = "rad/(s·V)"', 'unit = "rad/(sec·V)"', r"mine\.md:11: .*expected 'rad/\(s·V\)'"),
        (
            'unit = "rad/(s·V)"',
            'unit = "s"',
            r"mine\.md:11: blank 'gain': `read_gain` comes out in .* blank is 's'",
        ),
        ('unit = "rad/(s·V)"\n', "", r"mine\.md:11: blank 'gain': .* blank is 'none'"),
        (
            'answer = "read_gain"',
            'answer = "read_gian"',
            r"mine\.md:11: .*no fact called 'read_gian' \(did you mean 'read_gain'",
        ),
        ('answer = "read_gain"', 'answer = "sheet_gain"', r"mine\.md:11: .*names none; add nominal"),
        (
            'tolerance = "5 %"',
            'tolerance = "interval + 5"',
            r"mine\.md:11: .*'5' in .* has no unit; write \"5 %\"",
        ),
        ('tolerance = "5 %"', 'tolerence = "5 %"', r"mine\.md:16: .*did you mean 'tolerance'"),
        ('label = "Gain"\n', "", r"mine\.md:11: blanks\[0\]\.label: is missing"),
        ('duration = "2 s"', 'duration = "endless"', r"mine\.md:6: the experiment has to end within 600 s"),
        ('duration = "2 s"', 'duration = "601 s"', r"mine\.md:6: the experiment has to end within 600 s"),
        ("# What to do\n\nNothing +++ but this.\n", "", r"mine\.md:23: there is no text"),
    ],
)
def test_a_mistake_is_told_with_its_line(old: str, new: str, said: str) -> None:
    assert GOOD.count(old) >= 1

    with pytest.raises(UsageError, match=said):
        read(GOOD.replace(old, new, 1))


def test_a_mistake_in_a_blank_is_all_that_is_told_of_it() -> None:
    with pytest.raises(UsageError) as told:
        read(GOOD.replace('label = "Other"', 'label = "Other"\nhints = "?"'))

    [line] = str(told.value).splitlines()
    assert line.startswith("mine.md:21: blanks[1].hints: not known here (did you mean 'hint'?)")
    with pytest.raises(UsageError, match=r"blanks: \[\] has too few entries; expected at least 1"):
        read(GOOD.partition("[[blanks]]")[0].replace("order = 3", "blanks = []") + "+++\nText.\n")


@pytest.mark.parametrize(
    ("answer", "unit"),
    [
        ("1000 * log(2) * time_constant", "ms"),
        ("0.5 * sheet_gain", "rad/s"),  # the half is one of a volt
        ("sqrt(10 / sheet_time_constant)", "rad/s"),
        ("sheet_resistance * sheet_inertia / sheet_motor_constant ** 2", "s"),
        ("360 / counts_per_rev", "deg"),
        ("1 + 10 * sheet_time_constant", ""),
        ("sheet_motor_constant ** -1", "rad/(s·V)"),
        ("sqrt(sheet_inertia / sheet_inertia) * gain", "rad/(s·V)"),
    ],
)
def test_a_unit_that_may_fit_is_let_pass(answer: str, unit: str) -> None:
    text = GOOD.replace('"read_gain"', f'"{answer}"').replace('"rad/(s·V)"', f'"{unit}"')

    read(text.replace('duration = "2 s"', 'duration = "2 s"\nnominal = "qube_servo_2"'))


@pytest.mark.parametrize(
    ("answer", "unit", "comes_out_in"),
    [
        ("1000 * log(2) * time_constant", "V", "s"),
        (
            "coulomb_voltage - gain",
            "s",
            None,
        ),  # a sum of different things has no unit to hold anything against
        ("read_gain / read_time_constant * chain_lag", "V", "kg^-1·m^-2·s^2·A"),  # 1/(V·s)
        ("exp(gain)", "V", "no unit"),
        ("-abs(sample_time) * 1e3", "Hz", "s"),
        ("sqrt(time_constant / sample_time) * time_constant ** 2", "s", "s^2"),
        ("sqrt(time_constant) * sqrt(sample_time) * gain * coulomb_voltage", "rad/s", "no unit"),
        (
            "1 + 10 * coulomb_voltage + coulomb_voltage",
            "s",
            None,
        ),  # what a product with a number is in, is open
        ("coulomb_voltage + 10", "s", "V"),  # a number by itself is in the unit of the rest
        ("10 - coulomb_voltage", "s", "V"),
    ],
)
def test_a_unit_that_cannot_fit_is_refused(answer: str, unit: str, comes_out_in: str | None) -> None:
    text = GOOD.replace('"read_gain"', f'"{answer}"').replace('"rad/(s·V)"', f'"{unit}"')
    if comes_out_in is None:
        read(text)
        return
    with pytest.raises(UsageError) as told:
        read(text)

    assert f"comes out in {comes_out_in}, apart from" in str(told.value)


def test_the_facts_with_units_are_those_of_the_page() -> None:
    import re

    from servobench.lab.rules import units_of_facts

    page = Path(__file__).parents[2] / "docs" / "how-to" / "exercise.md"
    table = page.read_text(encoding="utf-8").partition("## The facts")[2]
    named = {
        name
        for row in re.findall(r"^\| (`.*?) \|", table, re.MULTILINE)
        for name in re.findall(r"`(\w+)`", row)
    }

    assert named <= set(units_of_facts())


def test_a_name_is_never_a_path(tmp_path: Path) -> None:
    folder = tmp_path / "exercises"
    folder.mkdir()
    (tmp_path / "secret.md").write_text(GOOD, encoding="utf-8")

    for name in ("../secret", "secret", "/etc/passwd", "..", "", "a\x00b"):
        with pytest.raises(UnknownName, match="no exercise called"):
            exercise(name, folder)


def test_a_file_that_is_no_text_is_told(tmp_path: Path) -> None:
    (tmp_path / "bad.md").write_bytes(b"+++\n\xff\n")

    with pytest.raises(FormatError, match=r"bad\.md:2: this is no UTF-8"):
        load_exercise(tmp_path / "bad.md")
    with pytest.raises(FormatError, match="can't be read"):
        load_exercise(tmp_path / "missing.md")


def test_a_file_that_is_nested_too_deeply_is_told() -> None:
    with pytest.raises(UsageError, match=r"mine\.md: arrays or tables are nested too deeply"):
        read(GOOD.replace('title = "Mine"', f"title = {'[' * 5000}{']' * 5000}"))
