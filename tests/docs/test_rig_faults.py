"""docs/reference/rig-faults.md: each row of it is there, in order, and each test that it names exists."""

import re

from tests.docs.pages import ROOT

ROWS = [*range(1, 16), 20, 28, 29]


def test_each_row_names_tests_that_exist() -> None:
    page = (ROOT / "docs" / "reference" / "rig-faults.md").read_text(encoding="utf-8")
    rows = {int(line.split("|")[1]): line for line in page.splitlines() if re.match(r"\| \d", line)}

    assert list(rows) == ROWS
    for row, line in rows.items():
        named = re.findall(r"`(tests/[\w/]+\.py)::(test_\w+)`", line)
        assert named, f"row {row} names no test"
        for file, name in named:
            assert f"def {name}(" in (ROOT / file).read_text(encoding="utf-8"), (
                f"row {row}: {file} has no {name}"
            )


def test_each_test_of_a_row_stands_on_the_page() -> None:
    page = (ROOT / "docs" / "reference" / "rig-faults.md").read_text(encoding="utf-8")
    file = ROOT / "tests" / "rig" / "simavr" / "test_faults.py"
    of_rows = re.findall(r"def (test_row_(\d\d)_\w+)\(", file.read_text(encoding="utf-8"))

    assert of_rows
    # Of a test with many cases and one beside it with few the page names the one with many.
    missing = [name for name, _ in of_rows if f"::{name}" not in page]
    assert missing == []
    for name, row in of_rows:
        (line,) = [line for line in page.splitlines() if line.startswith(f"| {int(row)} |")]
        assert f"::{name}" in line
