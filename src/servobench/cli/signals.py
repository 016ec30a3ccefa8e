"""`servobench signals`: the signals that an experiment can use."""

from __future__ import annotations

from servobench.cli.options import AsJson, MemberName


def signals(name: MemberName = None, as_json: AsJson = False) -> None:
    """List the signals, with their settings, units and defaults.

    With NAME, only that one. In an experiment's file: [signal], then type = "square", low = "1 V" and so on.
    """
    from servobench.cli.catalogue import list_members, with_settings
    from servobench.systems.signals.base import SIGNALS

    list_members("signal", with_settings(SIGNALS), name, as_json)
