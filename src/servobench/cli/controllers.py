"""`servobench controllers`: the control laws that an experiment can use."""

from __future__ import annotations

from servobench.cli.options import AsJson, MemberName


def controllers(name: MemberName = None, as_json: AsJson = False) -> None:
    """List the controllers, with their settings, units and defaults.

    With NAME, only that one. In an experiment's file: [controller], then type = "pid", kp = "2 V/rad" and so on; the signal
    is then the reference, in rad or rad/s. `servobench tune` finds the gains.
    """
    from servobench.cli.catalogue import list_members, with_settings
    from servobench.systems.control.base import CONTROLLERS

    list_members("controller", with_settings(CONTROLLERS), name, as_json)
