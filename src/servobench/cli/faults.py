"""`servobench faults`: the faults that can be injected on purpose."""

from __future__ import annotations

from servobench.cli.options import AsJson, MemberName


def faults(name: MemberName = None, as_json: AsJson = False) -> None:
    """List the faults that a run can inject, with their settings, units and defaults.

    With NAME, only that one. For one run: --fault "stuck_channel from=2s for=100ms".
    In an experiment's file: [[device.faults]], then name = "stuck_channel", from = "2 s" and so on.
    A recording with injected faults is marked.
    """
    from servobench.cli.catalogue import list_members, with_settings
    from servobench.rig.devices.faults.base import FAULTS

    list_members("fault", with_settings(FAULTS), name, as_json)
