"""The commands of `servobench lab`, as one group, and hints for forms that no longer exist."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import typer
from typer.core import TyperGroup

from servobench.cli.lab.assess import assess
from servobench.cli.lab.do import do
from servobench.cli.lab.listing import list_exercises
from servobench.cli.lab.mark import mark
from servobench.cli.lab.page import page
from servobench.core.errors import UsageError

_HELP = ("--help", "-h")


class _Group(TyperGroup):
    """The group; words that begin with none of its commands are an error that says which of them does that now."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        if not (ctx.resilient_parsing or (args and args[0] in (*self.commands, *_HELP))):
            raise UsageError(
                f"`servobench lab` is followed by {', '.join(self.commands)}; what you typed is now written "
                f"`servobench lab {_new_form(args)}`"
            )
        return super().parse_args(ctx, args)


lab = typer.Typer(name="lab", cls=_Group, rich_markup_mode=None)
lab.command("list")(list_exercises)
for command in (do, page, assess, mark):
    lab.command()(command)


@lab.callback()
def about() -> None:
    """Do the exercises, and assess a class with them."""


def _new_form(words: Sequence[str]) -> str:
    """The new form of a command line from the time when `servobench lab` was a single command."""
    options = {word.partition("=")[0] for word in words}
    name = words[0] if words and not words[0].startswith("-") else "NAME"
    if "--marks" in options:
        return f"mark {name} ROSTER.csv --secret FILE --forms DIR --marks MARKS.csv"
    if "--assess" in options:
        return f"assess {name} ROSTER.csv --secret FILE"
    if "--all" in options:
        return "page"
    if not options or (name == "NAME" and options <= {"--folder", words[-1]}):
        return "list"
    answer = " --answer BLANK=VALUE" if "--answers" in options else ""
    return f"do {name}{answer}{' --page PAGE.html' if '--out' in options else ''}"
