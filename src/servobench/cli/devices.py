"""`servobench devices`: the devices that an experiment can run on."""

from __future__ import annotations

from typing import Annotated

import typer


def devices(
    name: Annotated[str | None, typer.Argument(metavar="NAME", hidden=True)] = None,
) -> None:
    """List the devices, with their settings, units and defaults.

    With NAME, only that one. In an experiment's file: [device] with name = "twin", then [device.settings].
    """
    from servobench.cli.catalogue import show_members
    from servobench.cli.terminal import output
    from servobench.rig.devices.base import DEVICES

    members = {each: DEVICES[each] for each in DEVICES.names()}
    show_members(output(), "device", members, {each: found.Settings for each, found in members.items()}, name)
