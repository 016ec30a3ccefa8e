"""`servobench studies`: what an exercise can compute and show."""

from __future__ import annotations

from servobench.cli.options import AsJson, MemberName


def studies(name: MemberName = None, as_json: AsJson = False) -> None:
    """List the studies that an exercise can show, with their settings, units and defaults.

    With NAME, only that one. In an exercise's file: [studies.ANY_NAME], then type = "NAME" and the settings.
    """
    from servobench.cli.catalogue import list_members, with_settings
    from servobench.lab.studies.base import STUDIES

    list_members("study", with_settings(STUDIES), name, as_json)
