"""Translation of Python keywords in messages to options: `sample_time=0.02` is `--sample-time 0.02`."""

from __future__ import annotations

import re
from collections.abc import Mapping

OPTIONS: Mapping[str, str] = {
    "bandwidth": "--bandwidth",
    "chain": "--chain",
    "closed_loop": "--closed-loop",
    "counts_per_rev": "--counts-per-rev",
    "current": "--current",
    "damping": "--damping",
    "folder": "--folder",
    "inertia": "--inertia",
    "input": "--input",
    "input_value": "--input-value",
    "known": "--known",
    "measurement_delay": "--measurement-delay",
    "nominal": "--nominal",
    "out": "--out",
    "output": "--output",
    "pattern": "--pattern",
    "poles": "--poles",
    "port": "--port",
    "recording": "--from",
    "reference": "--reference",
    "scheduler": "--scheduler",
    "sample_time": "--sample-time",
    "structure": "--structure",
    "starts_at_rest": "--starts-at-rest",
    "supply": "--supply",
    "time": "--time",
    "turns": "--turns",
    "unit": "--unit",
    "until": "--until",
    "until_wrap": "--until-wrap",
    "voltage_limit": "--voltage-limit",
    "wheel_diameter": "--wheel-diameter",
    "with_motor": "--with-motor",
}
"""The option of each keyword that a message may name."""

CONTROLLER: Mapping[str, str] = {
    **OPTIONS,
    "counts_per_rev": "--controller-counts-per-rev",
    "sample_time": "--controller-sample-time",
}
"""The same for what is said of a controller, and not of data."""

TUNE: Mapping[str, str] = {**CONTROLLER, "closed_loop": "--lambda", "output": "--loop"}
"""The same for `servobench tune`."""

_KEYWORD = re.compile(r"`([a-z_]+)=([^`\n]+)`")
_WITHOUT_VALUE = ("...", "True")


def with_options(sentence: str, options: Mapping[str, str] = OPTIONS) -> str:
    """Return a sentence with options in the place of keywords; what isn't among the options stays as it is."""

    def option(match: re.Match[str]) -> str:
        name, value = match.groups()
        if name not in options:
            return match[0]
        return options[name] if value in _WITHOUT_VALUE else f"{options[name]} {value}"

    return _KEYWORD.sub(option, sentence)
