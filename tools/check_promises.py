"""Check docs/reference/safety.md: each promise has a number, a limit and tests that exist, and each marked test stands there.

A test says which promise it proves by `@pytest.mark.promise("S7")`; the page names it below that promise. Prints one line for
each fault, and exits with status 1; says nothing where all is well. The tests are read, not run.
"""

import ast
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PAGE = Path("docs") / "reference" / "safety.md"
HEADING = re.compile(r"### (?P<number>S[1-9]\d*): (?P<title>\S.*)")
TEST = re.compile(r"- `(?P<file>tests/[\w/]+\.py)::(?P<name>test_\w+)`")
COUNTED = re.compile(
    r"^Withdrawn numbers: (?P<withdrawn>.+)\. Next free number: S(?P<next>\d+)\.$", re.MULTILINE
)
LIMIT = "It can't "


@dataclass
class Promise:
    """A promise as the page has it: number, title, what is said, what it can't do, and the tests that prove it."""

    number: str
    title: str
    said: list[str] = field(default_factory=list)
    tests: list[tuple[str, str]] = field(default_factory=list)

    @property
    def sentence(self) -> str:
        """The promise itself: the first paragraph."""
        return next((line for line in self.said if not line.startswith(LIMIT)), "")

    @property
    def limit(self) -> str:
        """The limit of the promise."""
        return next((line for line in self.said if line.startswith(LIMIT)), "")


def promises(page: str) -> tuple[list[Promise], list[str]]:
    """Return the promises on the page, in order, and a line for each heading or list item that is none of theirs."""
    found: list[Promise] = []
    odd: list[str] = []
    inside = False
    for number, line in enumerate(page.splitlines(), start=1):
        if line.startswith("### "):
            match = HEADING.fullmatch(line)
            inside = match is not None
            if match is None:
                odd.append(f"line {number}: expected '### S<number>: <title>', got {line!r}")
            else:
                found.append(Promise(match["number"], match["title"]))
        elif line.startswith("## "):
            inside = False
        elif inside and line.strip():
            test = TEST.fullmatch(line)
            if test is not None:
                found[-1].tests.append((test["file"], test["name"]))
            elif line.startswith("- "):
                odd.append(f"line {number}: expected '- `tests/<file>.py::<test>`', got {line!r}")
            else:
                found[-1].said.append(line)
    return found, odd


def tests_in(root: Path) -> tuple[dict[tuple[str, str], set[str]], list[str]]:
    """Return the promises that each test function below `root`/tests is marked with, and a line for what can't be read.

    Only what pytest collects: functions `test_*` of a module `test_*.py`, of which a later one of the same name hides an earlier.
    """
    found: dict[tuple[str, str], set[str]] = {}
    odd: list[str] = []
    for path in sorted((root / "tests").rglob("test_*.py")):
        file = path.relative_to(root).as_posix()
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if not (isinstance(node, ast.FunctionDef) and node.name.startswith("test_")):
                continue
            numbers: set[str] = set()
            for argument in _marked(node):
                if isinstance(argument, ast.Constant) and isinstance(argument.value, str):
                    numbers.add(argument.value)
                else:
                    odd.append(f"{file}::{node.name}: a promise is marked by its number as a text")
            if (file, node.name) in found:
                odd.append(f"{file}::{node.name}: is hidden by another test of that name")
            found[file, node.name] = numbers
    return found, odd


def _marked(node: ast.FunctionDef) -> Iterator[ast.expr]:
    """The arguments of a test's marks `pytest.mark.promise(...)`."""
    for decorator in node.decorator_list:
        if isinstance(decorator, ast.Call) and ast.unparse(decorator.func) == "pytest.mark.promise":
            yield from decorator.args


def problems(root: Path = ROOT) -> list[str]:
    """Return everything that is wrong with the promises of the project at `root`, one line each."""
    page = (root / PAGE).read_text(encoding="utf-8")
    listed, odd_lines = promises(page)
    tests, odd_tests = tests_in(root)
    return [
        *odd_lines,
        *odd_tests,
        *_wrong_numbers(page, listed),
        *(fault for promise in listed for fault in _incomplete(promise, tests)),
        *_unlisted(listed, tests),
    ]


def _wrong_numbers(page: str, listed: list[Promise]) -> list[str]:
    """Numbers given twice, given again after they were withdrawn, and gone without a word."""
    counted = COUNTED.search(page)
    if counted is None:
        return ["expected a line 'Withdrawn numbers: none. Next free number: S<number>.'"]
    withdrawn = set() if counted["withdrawn"] == "none" else set(counted["withdrawn"].split(", "))
    numbers = [promise.number for promise in listed]
    due = {f"S{k}" for k in range(1, int(counted["next"]))}
    return [
        *(f"{number}: is given twice" for number in sorted(set(numbers)) if numbers.count(number) > 1),
        *(
            f"{number}: was withdrawn, and can't be given again"
            for number in sorted(withdrawn & set(numbers))
        ),
        *(
            f"{number}: is gone; list it among the withdrawn numbers"
            for number in sorted(due - withdrawn - set(numbers))
        ),
        *(
            f"{number}: isn't below the next free number"
            for number in sorted((withdrawn | set(numbers)) - due)
        ),
    ]


def _incomplete(promise: Promise, tests: dict[tuple[str, str], set[str]]) -> list[str]:
    """The missing parts of a promise, and those of its tests that don't prove it."""
    wrong = []
    if not promise.sentence:
        wrong.append(f"{promise.number}: says nothing")
    if not promise.limit:
        wrong.append(f"{promise.number}: doesn't say what it can't do; expected a line that begins {LIMIT!r}")
    if not promise.tests:
        wrong.append(f"{promise.number}: no test proves it")
    for file, name in promise.tests:
        if (file, name) not in tests:
            wrong.append(f"{promise.number}: there is no test {file}::{name}")
        elif promise.number not in tests[file, name]:
            wrong.append(
                f'{promise.number}: {file}::{name} isn\'t marked; add @pytest.mark.promise("{promise.number}")'
            )
        if promise.tests.count((file, name)) > 1:
            wrong.append(f"{promise.number}: names {file}::{name} twice")
    return wrong


def _unlisted(listed: list[Promise], tests: dict[tuple[str, str], set[str]]) -> list[str]:
    """Marks that stand on no page."""
    named = {(promise.number, test) for promise in listed for test in promise.tests}
    return [
        f"{file}::{name}: is marked {number}, and isn't listed below it"
        for (file, name), numbers in tests.items()
        for number in sorted(numbers)
        if (number, (file, name)) not in named
    ]


if __name__ == "__main__":
    found = problems()
    print("\n".join(found), end="\n" if found else "")
    sys.exit(1 if found else 0)
