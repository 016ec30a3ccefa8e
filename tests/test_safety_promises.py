"""The page of promises: each has a number of its own, a limit, and tests that say the same; its figures are the code's."""

from pathlib import Path

import pytest

from servobench.rig.devices.guard.steps import _FASTER
from servobench.rig.experiment import Limits
from servobench.rig.experiment.limits import StallLimits, Watchdog
from servobench.rig.loop.attendants import LOOK_EVERY, RECORDER_SILENT
from servobench.rig.loop.missed_ticks import FEWEST_TICKS, MissedTickRule
from servobench.rig.loop.process import LOOK_INTERVAL, SLOTS
from servobench.rig.loop.recording_process import INTERVAL
from tests.faults import test_row17_recorder_killed as row17
from tests.faults import test_row18_killed as row18
from tests.faults import test_row19_corrupted as row19
from tests.faults import test_row28_exception as row28
from tests.test_house import ROOT, tool

check = tool("check_promises")

PROMISE = """
### S{number}: Rest

The motor stands within 5 ms.

It can't brake.

- `tests/test_rest.py::test_it_stands`
"""
COUNTED = "Withdrawn numbers: {withdrawn}. Next free number: S{next}.\n"
PAGE = (
    COUNTED.format(withdrawn="S1", next=3)
    + PROMISE.format(number=2)
    + "\n## Later\n\n- a list of something else\n"
)
MARKED = '@pytest.mark.promise("S2")\ndef test_it_stands(): ...\n'


def project(folder: Path, page: str = PAGE, tests: str = MARKED) -> Path:
    """Return the folder, with that page and a file of tests in it."""
    (folder / "docs" / "reference").mkdir(parents=True)
    (folder / "tests").mkdir()
    (folder / "docs" / "reference" / "safety.md").write_text(page, encoding="utf-8")
    (folder / "tests" / "test_rest.py").write_text("import pytest\n\n\n" + tests, encoding="utf-8")
    return folder


def test_every_promise_has_its_number_its_limit_and_tests_that_say_the_same() -> None:
    assert check.problems() == []


def test_a_page_that_is_right_passes(tmp_path: Path) -> None:
    assert check.problems(project(tmp_path)) == []


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("- `tests/test_rest.py::test_it_stands`", "", "S2: no test proves it"),
        ("::test_it_stands", "::test_it_lies", "S2: there is no test tests/test_rest.py::test_it_lies"),
        ("tests/test_rest.py", "tests/test_work.py", "S2: there is no test tests/test_work.py::test_it_stands"),
        ("It can't brake.", "", "S2: doesn't say what it can't do"),
        ("The motor stands within 5 ms.", "", "S2: says nothing"),
        ("- `tests/test_rest.py::test_it_stands`", "- see the tests", "expected '- `tests/<file>.py::<test>`'"),
        ("### S2: Rest", "### Rest", "expected '### S<number>: <title>', got '### Rest'"),
        ("### S2: Rest", "### S1: Rest", "S1: was withdrawn, and can't be given again"),
        ("### S2: Rest", "### S3: Rest", "S3: isn't below the next free number"),
        ("### S2: Rest", "### S3: Rest", "S2: is gone; list it among the withdrawn numbers"),
        ("numbers: S1.", "numbers: none.", "S1: is gone"),
        ("Withdrawn numbers", "Numbers", "expected a line 'Withdrawn numbers"),
        ("## Later", PROMISE.format(number=2) + "\n## Later", "S2: is given twice"),
        (
            "::test_it_stands`",
            "::test_it_stands`\n- `tests/test_rest.py::test_it_stands`",
            "S2: names tests/test_rest.py::test_it_stands twice",
        ),
    ],
)  # fmt: skip
def test_a_page_that_is_wrong_is_found_out(tmp_path: Path, old: str, new: str, said: str) -> None:
    assert old in PAGE
    found = check.problems(project(tmp_path, page=PAGE.replace(old, new, 1)))

    assert any(said in problem for problem in found), found


@pytest.mark.parametrize(
    ("tests", "said"),
    [
        (MARKED.replace("@", "# @"), 'isn\'t marked; add @pytest.mark.promise("S2")'),
        (MARKED.replace('"S2"', '"S1"'), "test_it_stands: is marked S1, and isn't listed below it"),
        (MARKED.replace('"S2"', '"S2", "S9"'), "test_it_stands: is marked S9, and isn't listed below it"),
        (MARKED + "\n\n" + MARKED.replace("stands", "rests"), "test_it_rests: is marked S2, and isn't listed below it"),
        (MARKED.replace('"S2"', "NUMBER"), "a promise is marked by its number as a text"),
        (MARKED + "\n\n" + MARKED, "is hidden by another test of that name"),
        ("if False:\n    " + MARKED.replace("def", "    def"), "there is no test"),
        (MARKED.replace("test_it", "it"), "there is no test tests/test_rest.py::test_it_stands"),
    ],
)  # fmt: skip
def test_a_test_that_is_not_what_the_page_says_is_found_out(tmp_path: Path, tests: str, said: str) -> None:
    found = check.problems(project(tmp_path, tests=tests.strip() + "\n"))

    assert any(said in problem for problem in found), found


def test_a_test_that_is_parametrised_counts_by_its_name(tmp_path: Path) -> None:
    tests = '@pytest.mark.parametrize("k", [1, 2])\n' + MARKED.replace("()", "(k: int)")

    assert check.problems(project(tmp_path, tests=tests)) == []


def test_what_has_to_be_known_first_stands_first() -> None:
    """Before any promise, in words that nobody can miss."""
    top = (ROOT / check.PAGE).read_text(encoding="utf-8").partition("\n## ")[0]

    for words in (
        "Software isn't a safety function",
        "a switch in the motor's supply",
        "A killed loop can't put out zero volts",
        "Only the device's own watchdog stops the motor",
        "Never run on hardware",
        "Windows and macOS have none",
    ):
        assert words in top


def test_the_figures_on_the_page_are_those_of_the_code_and_of_the_tests() -> None:
    listed, _ = check.promises((ROOT / check.PAGE).read_text(encoding="utf-8"))
    said = {promise.number: promise.sentence + promise.limit for promise in listed}
    stall = StallLimits()
    timeouts = [0.02, 0.5]  # s; what is beyond is refused, as tests/rig/devices/test_guarded.py holds
    assert [Watchdog(timeout=timeout).timeout for timeout in timeouts] == timeouts
    least, most = (1000 * timeout for timeout in timeouts)
    rule = MissedTickRule(0.002)  # 250 ticks are half a second

    for number, figure in (
        ("S2", f"`limits.voltage` ({Limits().voltage:g} V)"),
        ("S7", f"slower than {stall.motion:g} rad/s at more than {stall.voltage:g} V"),
        ("S7", f"cut off after {stall.duration:g} s"),
        ("S9", f"more than {_FASTER:g} times its highest speed"),
        ("S14", f"for {1000 * Watchdog().timeout:g} ms ({least:g} to {most:g} ms, never off)"),
        ("S17", f"within {1000 * row28.WITHIN:g} ms of device time"),
        ("S21", f"within {1000 * LOOK_EVERY:g} ms of the run"),
        ("S23", f"silent for {RECORDER_SILENT:g} s"),
        ("S23", f"checks every {1000 * LOOK_INTERVAL:g} ms"),
        ("S23", f"at most {1000 * row17.LARGEST_LOSS:g} ms of samples"),
        ("S23", f"{SLOTS - 1:,} ticks"),
        ("S24", f"up to {1000 * INTERVAL:g} ms of samples"),
        ("S25", f"at least {100 * row18.SHARE:g} % of the samples older than {1000 * row18.OLD:g} ms"),
        ("S25", f"each of {row18.KILLS} random moments"),
        ("S26", f"{row19.MOST_MEMORY / 1e6:g} MB of memory"),
        ("S27", f"the last {1000 * INTERVAL:g} ms"),
        ("S29", f"{SLOTS - 1:,} rows"),
    ):
        assert figure in said[number]
    # S32: a tenth of half a second, ten ticks at least
    assert (rule._ticks, rule._most, FEWEST_TICKS) == (250, 25, 10)
