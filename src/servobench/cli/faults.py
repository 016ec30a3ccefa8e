"""`servobench faults`: what can be made to go wrong on purpose."""

from __future__ import annotations

from typing import Annotated, Any

import typer


def faults(
    name: Annotated[str | None, typer.Argument(metavar="NAME", hidden=True)] = None,
) -> None:
    """List the faults that a run can inject, with their settings, units and defaults.

    With NAME, only that one. For one run: --fault "stuck_channel from=2s for=100ms".
    In an experiment's file: [[device.faults]], then name = "stuck_channel", from = "2 s" and so on.
    A recording with injected faults is marked.
    """
    from servobench.cli.catalogue import show_members
    from servobench.cli.terminal import output
    from servobench.rig.devices.faults.base import FAULTS

    members: dict[str, Any] = {each: FAULTS[each] for each in FAULTS.names()}
    show_members(output(), "fault", members, members, name)
