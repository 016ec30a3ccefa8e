"""Below the command line a message names a thing by Python's keyword: whoever uses Python or the panel has no options.

`sample_time=0.02` in backticks is what `servobench.cli.option_names` turns into `--sample-time 0.02`, and the panel into a field.
A whole command in backticks, such as `servobench identify FILE --json`, can be typed by anybody and stays.
"""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import servobench

ROOT = Path(servobench.__file__).parent
OPTION = re.compile(r"(?<![\w(-])--(?:[a-z][a-z-]+|\{\})")
COMMAND = re.compile(r"`servobench [^`]*`|^servobench .*")

ALLOWED = {
    "compat/quanser/__main__.py": "a command line of its own",
    "rig/wire/conformance/__main__.py": "a command line of its own",
    "report/history.py": "the command that repeats what a report shows",
    "rig/loop/segment.py": "Docker's own option, for whoever runs servobench in a container",
}


def files() -> list[Path]:
    return sorted(path for path in ROOT.rglob("*.py") if path.relative_to(ROOT).parts[0] != "cli")


def sentences(path: Path) -> Iterator[tuple[int, str]]:
    """Each text in a file with its line, formatted ones with their holes as {}, but for docstrings."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    not_told = {
        id(node.value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            parts = [p.value if isinstance(p, ast.Constant) else "{}" for p in node.values]
            not_told |= {id(p) for p in ast.walk(node) if p is not node}
            yield node.lineno, "".join(map(str, parts))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in not_told:
            yield node.lineno, node.value


def named_options(path: Path) -> list[str]:
    return [
        f"{path.relative_to(ROOT)}:{line}: {found[0]}"
        for line, text in sentences(path)
        for found in OPTION.finditer(COMMAND.sub("", text))
    ]


def test_no_message_below_the_command_line_names_an_option() -> None:
    found = [
        each for path in files() if str(path.relative_to(ROOT)) not in ALLOWED for each in named_options(path)
    ]

    assert not found, "\n".join(found)


@pytest.mark.parametrize("name", ALLOWED)
def test_what_is_allowed_to_name_options_does(name: str) -> None:
    assert named_options(ROOT / name)
