"""`servobench devices`: the devices that an experiment can run on."""

from __future__ import annotations

from servobench.cli.options import AsJson, MemberName


def devices(name: MemberName = None, as_json: AsJson = False) -> None:
    """List the devices, with their settings, units and defaults.

    With NAME, only that one. In an experiment's file: [device] with name = "twin", then [device.settings].
    """
    from servobench.cli.catalogue import list_members, with_settings
    from servobench.rig.devices.base import DEVICES

    list_members("device", with_settings(DEVICES, lambda device: device.Settings), name, as_json)
