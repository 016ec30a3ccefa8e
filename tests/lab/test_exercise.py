"""Exercises as files: what a lecturer writes, and what is said of mistakes in it."""

import re
from pathlib import Path

import pytest

from servobench.core.errors import FormatError, UnknownName, UsageError
from servobench.lab.exercise_file import exercise, exercises, load_exercise, read_exercise

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
        ('title = "Mine"', "title = Mine", r"mine\.md:2: this isn't TOML"),
        ('title = "Mine"', 'titel = "Mine"', r"mine\.md:2: titel: not known here \(did you mean 'title'\?\)"),
        ('title = "Mine"\n', "", r"mine\.md:1: title: is missing; expected title ="),
        (
            'title = "Mine"',
            "title = “Mine”",
            r"mine\.md:2: .*`title = “Mine”`; texts need straight quotes",
        ),
        ('title = "Mine"', 'title = "  "', r"mine\.md:2: title"),
        ("[[blanks]]", "[blanks]", r"mine\.md"),
        (
            'duration = "2 s"',
            'duration = "2 s"\nchain = "lopass 5 Hz"',
            r"mine\.md:7: experiment\.chain: no stage",
        ),
        (
            'duration = "2 s"',
            'duration = "2 s"\nnominal = "qube"',
            r"mine\.md:7: experiment\.nominal: no data sheet",
        ),
        ("[signal]", "[motor]\n\n[signal]", r"mine\.md:8: motor: not known here; known: title, .*signal"),
        ('answer = "read_gain"', 'answer = "2 * ln(2)"', r"mine\.md:11: .*natural logarithm is called log"),
        ('answer = "read_gain"', 'answer = "read_gain^2"', r"mine\.md:11: .*a power is written as \*\*"),
        ('answer = "read_gain"', 'answer = "0,5 * read_gain"', r"mine\.md:11: .*has a decimal point"),
        (
            "Nothing",
            "\n{{ my-way }}\n\nNothing",
            r"mine\.md:28: there are no studies; add a table \[studies\.my-way\]",
        ),
        (
            "Nothing",
            "\nIt is\n$K/(τs + 1) here. Nothing",
            r"mine\.md:29: the formula that begins with `\$K/\(τs \+ 1\) here\. No",
        ),
        ("Nothing", "With $K $ nothing", r"mine\.md:27: the formula that begins with `\$K \$ nothing"),
        ("Nothing", "\n{{ way }\n\nNothing", r"mine\.md:28: `{{ way }` starts with {{ and doesn't end"),
        (
            "[signal]",
            "[studies.Way]\ntype = 'values'\n\n[signal]",
            r"mine\.md:8: studies\.Way: 'Way' isn't the name of a study",
        ),
        ('type = "step"', 'type = "stepp"', r"mine\.md:9: signal\.type: no signal called 'stepp'"),
        ('duration = "2 s"', 'duration = "2 V"', r"mine\.md:6: .*'2 V' is a voltage"),
        (
            'id = "gain"',
            'id = "Gain!"',
            r"mine\.md:12: blanks\[0\]\.id: 'Gain!' isn't the name of a blank; expected",
        ),
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
        ('duration = "2 s"', 'duration = "endless"', r"mine\.md:6: the experiment must end within 600 s"),
        ('duration = "2 s"', 'duration = "601 s"', r"mine\.md:6: the experiment must end within 600 s"),
        ("# What to do\n\nNothing +++ but this.\n", "", r"mine\.md:23: there is no text"),
    ],
)
def test_a_mistake_is_reported_with_its_line(old: str, new: str, said: str) -> None:
    assert GOOD.count(old) >= 1

    with pytest.raises(UsageError, match=said):
        read(GOOD.replace(old, new, 1))


@pytest.mark.parametrize(
    "text", ["$5 and then $6", "5 $ or 6 $, US$ 7", "`$HOME`", r"\$K", "$K$ and $5", "a $ sign", "$"]
)
def test_a_dollar_sign_may_stand_for_money(text: str) -> None:
    read(GOOD.replace("Nothing", text))


def test_a_mistake_in_a_blank_is_all_that_is_reported_of_it() -> None:
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
        ("gain * 1 - coulomb_voltage * gain", "rad/s"),  # the one is 1 V
        ("time_constant + 5", "ms"),
        ("gain * voltage_limit", "rad/s"),
        ("counts_per_rev / time_constant", "counts/s"),
        ("2 * pi * time_constant", "ms"),  # the two may be anything
        ("1 + 10 * coulomb_voltage + coulomb_voltage", "s"),  # what a product with a number is in, is open
    ],
)
def test_a_unit_that_may_fit_is_let_pass(answer: str, unit: str) -> None:
    text = GOOD.replace('"read_gain"', f'"{answer}"').replace('"rad/(s·V)"', f'"{unit}"')

    read(text.replace('duration = "2 s"', 'duration = "2 s"\nnominal = "qube_servo_2"'))


@pytest.mark.parametrize(
    ("answer", "unit", "comes_out_in"),
    [
        ("1000 * log(2) * time_constant", "V", "s"),
        ("read_gain / read_time_constant * chain_lag", "V", "rad/(s·V)"),
        ("exp(gain)", "V", "no unit"),
        ("-abs(sample_time) * 1e3", "Hz", "s"),
        ("sqrt(time_constant / sample_time) * time_constant ** 2", "s", "s^2"),
        ("sqrt(time_constant) * sqrt(sample_time) * gain * coulomb_voltage", "rad/s", "no unit"),
        ("coulomb_voltage + 10", "s", "V"),  # a number by itself is in the unit of the rest
        ("10 - coulomb_voltage", "s", "V"),
    ],
)
def test_a_unit_that_cannot_fit_is_refused(answer: str, unit: str, comes_out_in: str) -> None:
    text = GOOD.replace('"read_gain"', f'"{answer}"').replace('"rad/(s·V)"', f'"{unit}"')
    with pytest.raises(UsageError) as told:
        read(text)

    assert f"comes out in {comes_out_in}, apart from" in str(told.value)


@pytest.mark.parametrize(
    ("answer", "unit", "said"),
    [
        ("log(2) * time_constant", "ms", "in SI units, and the unit of the blank is 'ms'; multiply by 1000"),
        ("sheet_inductance", "mH", "multiply by 1000,"),
        ("gain * voltage_limit", "rpm", "multiply by 9.5493,"),  # 60/2π
        ("1 / time_constant ** 2", "1/ms^2", ""),  # 1 may be a quantity
        ("time_constant ** 2", "ms^2", "multiply by 1e+06,"),
        (
            "time_constant + gain",
            "s",
            "`time_constant` is in s and `gain` in rad/(s·V); different quantities",
        ),
        (
            "coulomb_voltage - gain",
            "s",
            "`coulomb_voltage` is in V and `gain` in rad/(s·V); different quantities",
        ),
    ],
)
def test_facts_without_a_number_are_in_si_units_and_sums_of_one_kind(
    answer: str, unit: str, said: str
) -> None:
    text = GOOD.replace('"read_gain"', f'"{answer}"').replace('"rad/(s·V)"', f'"{unit}"')
    text = text.replace('duration = "2 s"', 'duration = "2 s"\nnominal = "qube_servo_2"')
    if not said:
        read(text)
        return
    with pytest.raises(UsageError, match=rf"mine\.md:\d+: blank 'gain': .*{re.escape(said)}"):
        read(text)


CORRECTION = """
[[corrections]]
where = "II.E"
paper = "It is 0.13 s."
ours = "It is {}."
answer = "1000 * time_constant"
unit = "ms"
why = "The lag."
+++
"""


def test_a_corrections_figure_has_its_unit() -> None:
    good = GOOD.replace('"exact"\n+++\n', f'"exact"\n{CORRECTION}')
    assert "corrections" in good
    read(good)

    with pytest.raises(UsageError, match=r"comes out in s, .* unit of the correction is 'V'"):
        read(good.replace('unit = "ms"', 'unit = "V"'))


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


def test_a_file_that_is_no_text_is_reported(tmp_path: Path) -> None:
    (tmp_path / "bad.md").write_bytes(b"+++\n\xff\n")

    with pytest.raises(FormatError, match=r"bad\.md:2: this isn't UTF-8"):
        load_exercise(tmp_path / "bad.md")
    with pytest.raises(FormatError, match="can't be read"):
        load_exercise(tmp_path / "missing.md")


def test_a_file_that_is_nested_too_deeply_is_reported() -> None:
    with pytest.raises(UsageError, match=r"mine\.md: its arrays or tables are nested too deeply"):
        read(GOOD.replace('title = "Mine"', f"title = {'[' * 5000}{']' * 5000}"))
