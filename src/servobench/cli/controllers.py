"""`servobench controllers`: the control laws that an experiment can use."""

from __future__ import annotations

from typing import Annotated, Any

import typer


def controllers(
    name: Annotated[str | None, typer.Argument(metavar="NAME", hidden=True)] = None,
) -> None:
    """List the controllers, with their settings, units and defaults.

    With NAME, only that one. In an experiment's file: [controller], then type = "pid", kp = "2 V/rad" and so on; the signal
    is then the reference, in rad or rad/s. `servobench tune` finds the gains.
    """
    from servobench.cli.catalogue import show_members
    from servobench.cli.terminal import output
    from servobench.systems.control.base import CONTROLLERS

    members: dict[str, Any] = {each: CONTROLLERS[each] for each in CONTROLLERS.names()}
    show_members(output(), "controller", members, members, name)
