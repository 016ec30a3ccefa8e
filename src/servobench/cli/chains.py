"""`servobench chains`: what lies between the shaft and the speeds of known devices."""

from __future__ import annotations

from servobench.cli.options import AsJson, MemberName


def chains(
    name: MemberName = None,
    as_json: AsJson = False,
) -> None:
    """List the measurement chains of known devices, with their sources.

    With NAME, only that one. Each is a TEXT for `servobench identify FILE --chain TEXT`.
    """
    from servobench.cli.catalogue import Member, list_members
    from servobench.recordings.measurement.presets import PRESETS

    members = [
        Member(
            name=each.name,
            sentence=each.device,
            facts={
                "chain": each.chain,
                "lag": f"{1000 * each.lag:g} ms",
                "left open": each.uncertain,
                "source": list(each.sources),
            },
        )
        for each in PRESETS.values()
    ]
    list_members("known device", members, name, as_json)
