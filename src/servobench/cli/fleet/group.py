"""The commands of `servobench fleet`, put together; `servobench fleet SOURCE` is the first of them."""

from __future__ import annotations

from typing import Any

import typer
from typer.core import TyperGroup

from servobench.cli.fleet.identify import identify
from servobench.cli.fleet.repeatability import repeatability
from servobench.cli.fleet.watch import watch

_HELP = ("--help", "-h")


class _Group(TyperGroup):
    """The group; words that begin with none of its commands are those of `identify`."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        if not (ctx.resilient_parsing or (args and args[0] in (*self.commands, *_HELP))):
            args = ["identify", *args]
        return super().parse_args(ctx, args)


fleet = typer.Typer(name="fleet", cls=_Group, rich_markup_mode=None)
for command in (identify, repeatability, watch):
    fleet.command()(command)


@fleet.callback()
def about() -> None:
    """Identify many motors: a test stand's folder, a class, an object store.

    `servobench fleet SOURCE --out RESULTS` is short for `servobench fleet identify SOURCE --out RESULTS`.
    """
