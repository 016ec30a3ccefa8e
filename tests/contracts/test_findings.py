"""The table of finding codes is that of the source: every code raised has a row, and every row is raised somewhere."""

import ast
import functools
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from servobench.core.finding_codes import FINDING_CODES
from servobench.identification.trust.doubts.base import DOUBTS
from tests.test_architecture import PACKAGE
from tests.test_house import ROOT, tool

TABLE = PACKAGE / "core" / "finding_codes.py"
CODE = re.compile(r"[a-z0-9]+(-[a-z0-9]+)*")
KINDS = {"info", "warning", "refusal", "danger", "Finding", "Alarm"}
MAKERS = KINDS | {"severity", "found", "tell", "_finding"}  # one of the kinds under another name


def text_in(node: ast.AST) -> Iterator[str]:
    """The texts in the form of a code that an expression may be; of a table, its values."""
    if isinstance(node, ast.Dict):
        for value in node.values:
            yield from text_in(value)
    elif isinstance(node, ast.IfExp):
        yield from text_in(node.body)
        yield from text_in(node.orelse)
    elif isinstance(node, ast.Constant) and isinstance(node.value, str) and CODE.fullmatch(node.value):
        yield node.value


def codes_raised(tree: ast.Module) -> set[str]:
    """The codes with which a module makes findings: written there, or under a name that the module gives them."""
    found, names = set(), set()
    for call in (node for node in ast.walk(tree) if isinstance(node, ast.Call)):
        name = call.func.id if isinstance(call.func, ast.Name) else ""
        codes = [each.value for each in call.keywords if each.arg == "code"]
        codes += call.args[: 2 if name == "_finding" else 1] if name in MAKERS else []
        for code in codes:
            found |= {text for text in text_in(code) if "-" in text or name in KINDS}
            names |= {each.id for each in ast.walk(code) if isinstance(each, ast.Name)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Assign) and {getattr(each, "id", "") for each in node.targets} & names:
            found |= {text for text in text_in(node.value) if "-" in text}
    return found


@functools.cache
def sources() -> dict[Path, str]:
    """The package's modules, without the table."""
    return {path: path.read_text(encoding="utf-8") for path in sorted(PACKAGE.rglob("*.py")) if path != TABLE}


@functools.cache
def raised() -> dict[str, Path]:
    """The codes of the package, each with a module that makes findings with it."""
    return {code: path for path, text in sources().items() for code in codes_raised(ast.parse(text))}


def test_a_code_is_seen_wherever_it_is_written() -> None:
    tree = ast.parse(
        "A = 'first-one'\n"
        "B = {'x': 'of-a-table'}\n"
        "info(A, '')\nwarning(B[x], '')\nrefusal('written-here', '')\n"
        "danger('this-one' if x else 'that-one', '')\nTerm(code='of-a-term')\nother('not-a-code')\n"
    )

    assert codes_raised(tree) == {
        "first-one", "of-a-table", "written-here", "this-one", "that-one", "of-a-term",
    }  # fmt: skip


def test_every_code_that_the_source_raises_is_in_the_table() -> None:
    assert {code: path.name for code, path in raised().items() if code not in FINDING_CODES} == {}


def test_every_row_of_the_table_is_raised_somewhere() -> None:
    everything = "\n".join(sources().values())

    assert [code for code in FINDING_CODES if code not in raised() and f'"{code}"' not in everything] == []


def test_no_code_stands_in_the_table_twice() -> None:
    rows = re.findall(r'^    FindingCode\(\s*"([^"]+)"', TABLE.read_text(encoding="utf-8"), re.MULTILINE)

    assert rows == sorted(FINDING_CODES)
    assert len(rows) > 250


@pytest.mark.parametrize("name", DOUBTS.names())
def test_a_doubt_raises_codes_of_the_table(name: str) -> None:
    without = set(DOUBTS[name].codes) - set(FINDING_CODES)

    assert not without, f"add a row to {TABLE.relative_to(ROOT)}, in alphabetical order: {without}"


def test_the_page_of_findings_is_the_table() -> None:
    written = (ROOT / "docs" / "reference" / "findings.md").read_text(encoding="utf-8")

    assert written == tool("write_findings").page()
