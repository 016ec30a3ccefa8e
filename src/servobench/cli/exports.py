"""`servobench exports`: the programs that an identified motor can be written for."""

from __future__ import annotations

from servobench.cli.options import AsJson, MemberName


def exports(name: MemberName = None, as_json: AsJson = False) -> None:
    """List what an identified motor can be written as, and the options that each one takes.

    With NAME, only that one: `servobench export RESULT --as NAME`.
    """
    from servobench.cli.catalogue import Member, list_members
    from servobench.cli.option_names import CONTROLLER
    from servobench.export.base import TARGETS

    members = [
        Member(
            name=each,
            sentence=TARGETS.sentence(each),
            facts={
                "ending": TARGETS[each].suffix,
                "options": sorted(CONTROLLER[wish] for wish in TARGETS[each].wishes),
            },
        )
        for each in TARGETS.names()
    ]
    list_members("export target", members, name, as_json)
