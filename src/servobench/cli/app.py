"""All commands as one application; each command is in the file of its name."""

from __future__ import annotations

import logging
import os
import shlex
from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Annotated

import typer

from servobench._version import __version__
from servobench.cli.failures import (
    CANNOT_WRITE,
    DONE,
    OUR_FAULT,
    USER_MISTAKE,
    flush_output,
    report_failure,
)
from servobench.cli.terminal import messages, say, spell_what_cannot_be_encoded
from servobench.rig.loop.leftovers import sweep

_DEBUG = "--debug"
_STATUSES = (
    "Exit status: 0 a result, trusted or doubtful; 1 a fault of servobench; 2 wrong usage or a file that can't be read; "
    "3 refused, as the data can't support a model; 4 the device failed; 5 nothing more could be written; 6 a motor fails its "
    "limits; 7 none fails, but some are undecided; 130 interrupted."
)


def _show_version(requested: bool) -> None:
    if requested:
        typer.echo(f"servobench {__version__}")
        raise typer.Exit


def servobench(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_show_version, is_eager=True, help="Print the version and exit."),
    ] = False,
    debug: Annotated[
        bool, typer.Option(_DEBUG, help="Show the traceback of any error; may appear anywhere in the line.")
    ] = False,
) -> None:
    """From a servo motor, simulated or real, or a recording of one, to its transfer function.

    With intervals that cover, and the reasons to trust it or not. `servobench run` alone identifies the simulated motor.
    """


_COMMANDS = (
    "run",
    "identify",
    "watch",
    "commission",
    "why",
    "design",
    "tune",
    "stability",
    "honest",
    "ensemble",
    "inspect",
    "export",
    "convert",
    "recover",
    "panel",
    "devices",
    "faults",
    "signals",
    "controllers",
    "chains",
    "structures",
    "estimators",
    "formats",
    "exports",
    "studies",
    "completion",
)


def application(words: Sequence[str] = ()) -> typer.Typer:
    """Return all commands as one application, or the one that the words ask for alone: typer looks at each.

    `completion` is never alone, as it lists the others.
    """
    made = typer.Typer(
        name="servobench",
        rich_markup_mode=None,  # plain text, the same on every terminal and in the stored help
        pretty_exceptions_enable=False,
        add_completion=False,
        context_settings={"help_option_names": ["-h", "--help"], "terminal_width": 80},
    )
    made.callback(epilog=_STATUSES)(servobench)
    alone = [name for name in _COMMANDS if [name] == list(words[:1]) and name != "completion"]
    for name in alone or _COMMANDS:
        made.command()(_command(name))
    if not alone:
        from servobench.cli.fleet.group import fleet
        from servobench.cli.lab.group import lab

        made.add_typer(fleet)
        made.add_typer(lab)
    return made


def _command(name: str) -> Callable[..., None]:
    """The command of a name, from its file: a command line needs one of them."""
    command: Callable[..., None] = getattr(import_module(f"servobench.cli.{name}"), name)
    return command


def __getattr__(name: str) -> typer.Typer:
    """Return `app`: all commands as one application, put together when it is asked for."""
    if name != "app":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return application()


def run_app(words: Sequence[str]) -> int:
    """Run the command that the words of a command line ask for, and return the exit status."""
    spell_what_cannot_be_encoded()
    sweep()
    # Its warning about a folder that it can't write to doesn't concern a user who wants a report.
    logging.getLogger("matplotlib").setLevel(logging.ERROR)
    words, debug = _without_debug(words)
    try:
        # The object that typer hands to commands is the line as it was typed, for reports.
        application(words)(
            words or ["--help"], prog_name="servobench", obj=shlex.join(["servobench", *words])
        )
    except SystemExit as end:
        interrupt = _interrupt_behind(end)
        if interrupt is None and _status(end) == USER_MISTAKE:
            _name_dashed_file(words)
        return flush_output(_status(end) if interrupt is None else report_failure(interrupt, debug=debug))
    except BaseException as error:
        return flush_output(report_failure(error, debug=debug))
    return flush_output(DONE)


def _without_debug(words: Sequence[str]) -> tuple[list[str], bool]:
    """The words without the wish to see tracebacks, which may stand anywhere, and whether it was there."""
    # What follows "--" are names of files, whatever they look like.
    end = words.index("--") if "--" in words else len(words)
    options = [word for word in words[:end] if word != _DEBUG]
    return [*options, *words[end:]], len(options) < end


def _name_dashed_file(words: Sequence[str]) -> None:
    """Say how to name a file whose name begins with a dash, where one of the words is such a file's."""
    options = words[: words.index("--")] if "--" in words else words
    for word in options:
        if word.startswith("-") and os.path.isfile(word):
            say(
                messages(),
                f"{word} was read as options, as it begins with a dash; for the file, write ./{word}",
            )


def _interrupt_behind(end: SystemExit) -> KeyboardInterrupt | None:
    """The Ctrl-C that ended a command, which typer turns into a silent exit; None where it ended by itself."""
    error: BaseException | None = end
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error


def _status(end: SystemExit) -> int:
    """The exit status that typer ends with; its 1 means that the reader of the output has gone."""
    if end.code == OUR_FAULT:
        return CANNOT_WRITE
    return end.code if isinstance(end.code, int) else DONE
