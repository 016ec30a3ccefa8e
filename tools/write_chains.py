"""Write docs/reference/chains.md from the chains of known devices; a test holds the page equal to this."""

from pathlib import Path

from servobench.recordings.measurement.base import STAGES
from servobench.recordings.measurement.presets import PRESETS, Preset

PAGE = Path(__file__).resolve().parent.parent / "docs" / "reference" / "chains.md"

HEAD = """# Chains

<!-- Written by tools/write_chains.py from servobench/recordings/measurement/presets.py: change that, run `make generate`. -->

`--chain TEXT` says what lies between the shaft and the output ([why that matters](../why/chain-in-the-estimator.md)):
stages joined by `|`, or the name of a device that is listed below, or `none` where nothing is in between.
`servobench chains` prints the devices.

## Stages
"""

DEVICES = """
## Known devices

What a device reports with its own defaults. Whoever changed its settings writes the stages out instead.
The lag is that of slow signals.
A device that isn't here has no published figures that could be found; [ask its maker](#what-to-ask-for).
"""

TAIL = """## What to ask for

Over which time is a difference taken, over how many samples and what time apart is it averaged, which filter follows
with which cut-off, and how often is the value sent? Or record the position, which needs no chain.
"""


def page() -> str:
    """Return the page."""
    stages = [
        f"- `{name}`: {_sentence(name)} `{'`, `'.join(STAGES[name].examples)}`" for name in STAGES.names()
    ]
    devices = [line for preset in PRESETS.values() for line in _device(preset)]
    return "\n".join([HEAD, *stages, DEVICES, *devices, TAIL])


def _sentence(name: str) -> str:
    """A stage's description: the first line of its file, without its name."""
    import sys

    said = (sys.modules[STAGES[name].__module__].__doc__ or "").strip().splitlines()[0]
    return said.partition(": ")[2]


def _device(preset: Preset) -> list[str]:
    return [
        f"### {preset.name}",
        "",
        f"{preset.device}: `{preset.chain}`, a lag of {1000 * preset.lag:g} ms.",
        preset.uncertain,
        "",
        *(f"- Source: {source}" for source in preset.sources),
        "",
    ]


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8", newline="\n")
