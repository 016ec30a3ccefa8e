"""The picture of the architecture is that of the tree: rooms, what is in them, and who may use whom."""

import ast
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.test_house import ROOT

PACKAGE = ROOT / "src" / "servobench"
PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
MOST_ROOMS = 12
NO_ROOMS = {"__init__", "__main__", "_version", "py.typed"}
DRAWN = [
    re.findall(r"[a-z]+", re.split(r"  +", line.strip())[0])
    for line in re.findall(r"(?:^    .*\n)+", PAGE, re.MULTILINE)[0].splitlines()
]
INSIDE = {
    room: set(re.findall(r"`(\w+)`", names))
    for room, names in re.findall(r"^\| `(\w+)` \| (`.*`) \|$", PAGE, re.MULTILINE)
}


def entries(folder: Path) -> set[str]:
    """The modules and folders in a folder of the package; schemas are no code."""
    return {
        each.stem if each.suffix == ".py" else each.name
        for each in folder.iterdir()
        if each.name not in {"__pycache__", "__init__.py", "schemas"}
    }


def contract(container: str) -> list[str]:
    """The layers of a container, top first, as import-linter holds them."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    (found,) = [
        each["layers"]
        for each in settings["tool"]["importlinter"]["contracts"]
        if each["type"] == "layers" and each["containers"] == [container]
    ]
    return list(found)


def test_there_are_twelve_rooms_at_most() -> None:
    assert len(entries(PACKAGE) - NO_ROOMS) <= MOST_ROOMS


def test_the_picture_shows_every_room_and_nothing_else() -> None:
    assert {room for line in DRAWN for room in line} == entries(PACKAGE) - NO_ROOMS


def test_the_picture_is_the_contract_that_imports_are_held_to() -> None:
    layers = [re.sub(r"\(\w+\)", "", layer) for layer in contract("servobench")]  # some aren't there yet
    of_the_contract = [set(re.findall(r"\w+", layer)) for layer in layers]

    assert [set(line) for line in DRAWN] == [layer for layer in of_the_contract if layer]


@pytest.mark.parametrize("room", sorted(INSIDE))
def test_the_table_names_all_that_is_in_a_room(room: str) -> None:
    assert INSIDE[room] == entries(PACKAGE / room)


def about(room: str) -> str:
    """A room's description of itself."""
    text = ast.get_docstring(ast.parse((PACKAGE / room / "__init__.py").read_text(encoding="utf-8")))
    assert text is not None
    return text


def imported(room: str) -> set[str]:
    """The rooms that the files of a room import, here or there, for a type or at run time."""
    found = set()
    for path in (PACKAGE / room).rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("servobench."):
                found.add((node.module or "").split(".")[1])
    return found - {room} - NO_ROOMS


@pytest.mark.parametrize("room", sorted(INSIDE))
def test_a_room_says_what_lives_in_it(room: str) -> None:
    assert entries(PACKAGE / room) <= set(re.findall(r"`(\w+)`", about(room)))


@pytest.mark.parametrize("room", sorted(entries(PACKAGE) - NO_ROOMS))
def test_a_room_says_which_rooms_it_uses(room: str) -> None:
    rooms = entries(PACKAGE) - NO_ROOMS
    said = re.search(r"It\s+uses\s[^.;]*", about(room))

    assert said is not None
    assert set(re.findall(r"`(\w+)`", said[0])) & rooms == imported(room)


def test_every_path_on_the_page_is_there() -> None:
    named = re.findall(r"`((?:\w+/)+\w+(?:\.py)?|\w+\.py)`", PAGE)

    assert len(named) > 30
    gone = [
        path
        for path in named
        if not any(
            (root / path).exists() for root in (PACKAGE, ROOT, *PACKAGE.glob("*/*"), *PACKAGE.glob("*"))
        )
    ]
    assert gone == []


# A name is a noun for what a function returns, or an imperative for what it does: `required_fact`, `run_ticks`.
PARTICIPLE = re.compile(
    r"\w+(ed|en|ing)|told|known|drawn|held|seen|kept|made|said|shown|found|left|put|met|begun|gone|done|built|spent|sent|lost"
)
VERBS_AND_NOUNS = {
    "anything", "between", "bring", "clipping", "codegen", "crossing", "drawing", "embed", "ending", "even", "feed", "finding",
    "happen", "heading", "heed", "len", "listen", "mapping", "meaning", "nothing", "open", "opening", "pen", "put",
    "reading", "recording", "rounding", "seed", "setting", "settling", "smoothing", "spacing", "speed", "swing",
    "switching", "then", "timing", "tracking", "training", "warming", "warning", "weighting", "whiten", "widen", "winding",
}  # fmt: skip
BEFORE_A_NOUN = {
    "closed", "damped", "expected", "filtered", "fixed", "leading", "measured", "missing", "moving", "operating",
    "remaining", "required", "rounded", "sampled", "squared", "turning", "uncompressed",
}  # fmt: skip
INTERFACES = {
    "compiled",
    "elapsed",
    "sliding",
    "unmodelled",
    "unsupported",
}  # plug-ins and decorators are written with these


def is_property(node: ast.FunctionDef | ast.AsyncFunctionDef) -> bool:
    return any("property" in ast.unparse(decorator) for decorator in node.decorator_list)


def begins_with_a_participle(name: str) -> bool:
    first, *more = name.strip("_").split("_")
    if first in VERBS_AND_NOUNS or name in INTERFACES or (more and first in BEFORE_A_NOUN):
        return False
    return PARTICIPLE.fullmatch(first) is not None


@pytest.mark.parametrize(
    "name", ["told", "_held", "known_values", "fitted", "searched", "filtered", "left_in"]
)
def test_a_participle_is_seen_in_a_name(name: str) -> None:
    assert begins_with_a_participle(name)


def test_a_function_is_named_after_what_it_returns_or_does() -> None:
    found = [
        f"{path.relative_to(PACKAGE)}:{node.lineno}: {node.name}"
        for path in sorted(PACKAGE.rglob("*.py"))
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        and not is_property(node)
        and begins_with_a_participle(node.name)
    ]

    assert found == [], (
        "a noun for the result or an imperative for the act, such as `required_fact` or `run_ticks`"
    )


# Words that say how one came by a thing, and nothing of the thing. Fields that files and users know by such a name keep it.
SAYS_NOTHING = {"found", "given", "seen", "kept", "drawn"}


def variables(function: ast.AST) -> Iterator[tuple[int, str]]:
    """The line and the name of each argument of a function, and of each variable that it sets."""
    for node in ast.walk(function):
        if isinstance(node, ast.arg):
            yield node.lineno, node.arg
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.lineno, node.id


def test_the_variables_of_a_function_are_seen() -> None:
    text = "def f(a, *, b):\n    c = a\n    return [d for d in c if (e := d)]"

    assert [name for _, name in variables(ast.parse(text))] == ["a", "b", "c", "d", "e"]


def test_a_variable_is_named_after_what_it_holds() -> None:
    vague = [
        f"{path.relative_to(PACKAGE)}:{line}: {name}"
        for path in sorted(PACKAGE.rglob("*.py"))
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        for line, name in variables(node)
        if name in SAYS_NOTHING
    ]

    assert vague == [], "a noun for the thing, such as `intervals`, `columns` or `settings`"
