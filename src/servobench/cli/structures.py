"""`servobench structures`: the model structures that can be fitted."""

from __future__ import annotations

from servobench.cli.options import AsJson, MemberName


def structures(name: MemberName = None, as_json: AsJson = False) -> None:
    """List the model structures, with their parameters and units.

    With NAME, only that one: `servobench identify FILE --structure NAME`. Some are made from the parts of their names.
    """
    from servobench.cli.catalogue import Member, list_members
    from servobench.identification.models.base import STRUCTURES

    known = [*STRUCTURES.names(), *([name] if name is not None and name not in STRUCTURES.names() else [])]
    members = [
        Member(
            name=each,
            sentence=STRUCTURES.sentence(each),
            parameters=tuple(
                {
                    "name": parameter.name,
                    "unit": parameter.unit.format(position="rad", output="rad", input="V"),
                    "meaning": parameter.meaning,
                }
                for parameter in STRUCTURES[each].parameters
            ),
        )
        for each in known
    ]
    families = [Member(name=form, sentence=sentence) for form, sentence in STRUCTURES.families().items()]
    list_members("model structure", [*members, *families], name, as_json)
