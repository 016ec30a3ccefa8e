"""Write the help texts that `servobench --help` prints without waiting for anything to be imported.

They are what the commands themselves would say; a test holds the two equal. After a change of a command or an option,
run `make generate`.
"""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import typer.main

from servobench.cli.app import app

FOLDER = Path(__file__).resolve().parent.parent / "src" / "servobench" / "cli" / "help"


def pages() -> dict[str, str]:
    """Return the help texts by the names of their files: of all commands together, and of each."""
    return dict(_pages(typer.main.get_command(app), "servobench"))


def _pages(command: Any, name: str, parent: Any = None) -> Iterator[tuple[str, str]]:
    """The text of a command and, where it is a group, those of its commands."""
    word = name.rpartition("-")[2]
    context = command.make_context(word, [], parent=parent, resilient_parsing=True)
    yield f"{name}.txt", f"{command.get_help(context).rstrip()}\n"
    for inner, each in getattr(command, "commands", {}).items():
        yield from _pages(each, f"{name}-{inner}", context)


def write(folder: Path = FOLDER) -> None:
    """Write the texts into a folder, and remove those of commands that there aren't any more."""
    folder.mkdir(exist_ok=True)
    current = pages()
    for old in folder.glob("*.txt"):
        if old.name not in current:
            old.unlink()
    for name, text in current.items():
        (folder / name).write_text(text, encoding="ascii", newline="\n")


if __name__ == "__main__":
    write()
    sys.exit(0)
