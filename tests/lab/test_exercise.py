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
        ('id = "other"', 'id = "gain"', r"two blanks have the id 'gain'"),
        ('answer = "read_gain"', 'answer = "import os"', r"mine\.md:11: blanks\[0\]: .*is no expression"),
        ('tolerance = "5 %"', 'tolerance = "5 V"', r"mine\.md:11: blanks\[0\]: .*tolerance"),
        ('unit = "rad/(s·V)"', 'unit = "furlongs"', r"mine\.md:11: blanks\[0\]: .*furlongs"),
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
