"""`servobench chains`: what lies between the shaft and the speeds of known devices."""

from __future__ import annotations

from typing import Annotated

import typer


def chains(
    name: Annotated[str | None, typer.Argument(metavar="NAME", hidden=True)] = None,
) -> None:
    """List the measurement chains of known devices, with their sources.

    With NAME, only that one. Each is a TEXT for `servobench identify FILE --chain TEXT`.
    """
    from rich.text import Text

    from servobench.cli.layout import show_wrapped
    from servobench.cli.terminal import output
    from servobench.core.errors import UnknownName
    from servobench.recordings.measurement.presets import PRESETS

    if name is not None and name not in PRESETS:
        raise UnknownName("known device", name, PRESETS)
    console = output()
    for each in PRESETS.values() if name is None else [PRESETS[name]]:
        show_wrapped(console, Text(f"{each.name}  ", style="bold"), each.device, hanging=0)
        told = f"{each.chain}   (a lag of {1000 * each.lag:g} ms)"
        for sentence in (told, each.uncertain, *(f"Source: {source}" for source in each.sources)):
            show_wrapped(console, Text("  "), sentence, hanging=4)
        console.print()
