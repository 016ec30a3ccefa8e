"""`servobench signals`: the signals that an experiment can use."""

from __future__ import annotations

from typing import Annotated, Any

import typer


def signals(
    name: Annotated[str | None, typer.Argument(metavar="NAME", hidden=True)] = None,
) -> None:
    """List the signals, with their settings, units and defaults.

    With NAME, only that one. In an experiment's file: [signal], then type = "square", low = "1 V" and so on.
    """
    from servobench.cli.catalogue import show_members
    from servobench.cli.terminal import output
    from servobench.systems.signals.base import SIGNALS

    members: dict[str, Any] = {each: SIGNALS[each] for each in SIGNALS.names()}
    show_members(output(), "signal", members, members, name)
