"""`servobench formats`: the file formats of recordings."""

from __future__ import annotations

from servobench.cli.options import AsJson, MemberName


def formats(name: MemberName = None, as_json: AsJson = False) -> None:
    """List the file formats of recordings, with the endings of their names.

    With NAME, only that one. `servobench inspect FILE` says which one a file is of.
    """
    from servobench.cli.catalogue import Member, list_members
    from servobench.recordings.formats.base import FORMATS

    members = [
        Member(
            name=name,
            sentence=FORMATS.sentence(name),
            facts={"endings": list(FORMATS[name].suffixes), "written": list(FORMATS[name].written)},
        )
        for name in FORMATS.names()
    ]
    list_members("file format", members, name, as_json)
