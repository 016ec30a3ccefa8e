"""The command line: `servobench`, and `python -m servobench`.

Each command has a file of its own, and `app` lists them. Help and version are printed from stored texts before anything else is
imported, so they appear at once. It uses `panel`, `lab`, `fleet`, `report`, `export`, `identification`, `rig`, `recordings`,
`systems` and `core`; nothing uses it.
"""

from __future__ import annotations

import gc
import os
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

_HELP = ("--help", "-h")
_INTERRUPTED = 130  # as in `failures`, which isn't imported before it has to be


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line with these arguments, those of the process where there are none, and return the exit status."""
    if arguments is not None:
        return _run(list(arguments))
    # This process runs a single command, so these settings disturb no other code; decision 0049 has the figures.
    # The matrices of a fit are narrow: several threads wait for each other longer than they compute. It has to be said before
    # NumPy is imported; a value that the user has set is kept.
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    os.environ.setdefault("VECLIB_MAXIMUM_THREADS", "1")
    # Garbage is looked for less often while a thousand modules are imported, which make none, and not at all at the end, when
    # the system takes the memory back.
    gc.set_threshold(100_000, 50, 100)
    try:
        return _run(sys.argv[1:])
    finally:
        gc.freeze()


def _run(words: list[str]) -> int:
    """Run the command line with these words."""
    text = _text_on_disk(words)
    if text is not None and _print_text(text):
        return 0
    try:
        from servobench.cli.app import run_app

        return run_app(words)
    except KeyboardInterrupt:
        # What tells of any other end isn't there yet.
        sys.stderr.write("Error: interrupted before anything was done\n")
        return _INTERRUPTED


def _text_on_disk(words: list[str]) -> str | None:
    """The text that answers these words, None where the words ask for more than help or the version."""
    if words == ["--version"]:
        from servobench._version import __version__

        return f"servobench {__version__}\n"
    names = words[:-1]
    if words and words[-1] not in _HELP:
        return None
    # A name that isn't of letters alone could lead out of the folder.
    is_page = all(name.islower() and name.isalpha() for name in names)
    return _help_text("-".join(["servobench", *names])) if is_page else None


def _help_text(page: str) -> str | None:
    """A page of help, None where there is no such page."""
    try:
        with open(os.path.join(os.path.dirname(__file__), "help", f"{page}.txt"), encoding="ascii") as file:
            return file.read()
    except OSError:
        return None


def _print_text(text: str) -> bool:
    """Print a text; return False if the reader of the output has gone, which is reported as for any other command."""
    try:
        sys.stdout.write(text)
        sys.stdout.flush()
    except (OSError, AttributeError):  # AttributeError: the process was started without an output
        return False
    return True
