"""Write the help texts that `servobench --help` prints without waiting for anything to be imported.

They are what the commands themselves would say; a test holds the two equal. After a change of a command or an option,
run `make generate`.
"""

import sys
from pathlib import Path

import typer.main

from servobench.cli.app import app

FOLDER = Path(__file__).resolve().parent.parent / "src" / "servobench" / "cli" / "help"


def pages() -> dict[str, str]:
    """Return the help texts by the names of their files: of all commands together, and of each."""
    everything = typer.main.get_command(app)
    context = everything.make_context("servobench", [], resilient_parsing=True)
    texts = {"servobench.txt": everything.get_help(context)}
    for name in everything.list_commands(context):
        command = everything.get_command(context, name)
        inner = command.make_context(name, [], parent=context, resilient_parsing=True)
        texts[f"servobench-{name}.txt"] = command.get_help(inner)
    return {name: f"{text.rstrip()}\n" for name, text in texts.items()}


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
