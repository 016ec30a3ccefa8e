"""What whoever goes on with a result's numbers has to know: which of them the data don't determine, and where they hold."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from servobench.core.finding import list_text
from servobench.core.parameter_names import parameter_in_words
from servobench.core.rounding import Rounded, rounded_interval
from servobench.identification.uncertainty.identifiability import State
from servobench.identification.uncertainty.status_text import bound_text

_WHERE = "gain-local"  # the finding that says at which operating point a gain holds
_CHOICE = "one choice of many that fit the data equally well."


def cautions(document: Mapping[str, Any]) -> tuple[str, ...]:
    """Return sentences on the parameters that a result doesn't know by themselves, and on the range in which its gain holds.

    `document` is the result as plain data of the schema `servobench.result/2`. A delay has none: models, margins and constants
    allow for all of its interval. One of an older schema, which has no states, has none either.
    """
    parameters = document.get("parameters") or {}
    open_ones = [
        name
        for name, each in parameters.items()
        if name != "delay" and each.get("state", State.KNOWN) != State.KNOWN
    ]
    sentences = list(_open(open_ones, document))
    if sentences:
        words = list_text([parameter_in_words(name, parameters[name]["unit"]) for name in open_ones])
        values = f"value of the {words} is" if len(open_ones) == 1 else f"values of {words} are"
        sentences.append(f"The {values} {_CHOICE}")
    range_sentences = [
        each["sentence"] for each in document.get("findings", []) if each.get("code") == _WHERE
    ]
    return (*sentences, *range_sentences)


def _open(names: Sequence[str], document: Mapping[str, Any]) -> Iterator[str]:
    """A sentence for each combination that parameters are known in, each bound, and those that aren't known at all."""
    parameters, combinations = document["parameters"], document.get("combinations") or {}
    words = {name: f"the {parameter_in_words(name, parameters[name]['unit'])}" for name in names}
    unknown = []
    together: dict[str, list[str]] = {}
    for name in names:
        plain = parameters[name]
        if plain["state"] == State.COMBINATION and plain.get("combination") in combinations:
            together.setdefault(plain["combination"], []).append(words[name])
        elif plain["state"] == State.BOUNDED:
            mirrored = name == "coulomb_voltage" and _loses_below_zero(document)
            end = bound_text(plain["value"], _ends(plain), plain["unit"], mirrored)
            yield _sentence(f"{words[name]} isn't known, only that it is {end}")
        else:
            unknown.append(words[name])
    for key, those in together.items():
        alone = "by themselves" if len(those) > 1 else "by itself"
        whole = f"{combinations[key]['meaning']} is {_interval(combinations[key])}"
        yield _sentence(f"{list_text(those)} {_are_not(those)} known {alone}; {whole}")
    if unknown:
        yield _sentence(f"{list_text(unknown)} {_are_not(unknown)} known")


def _loses_below_zero(document: Mapping[str, Any]) -> bool:
    """Whether the constant that a motor loses is below zero: one that braked a motor under a negative input."""
    if not str(document.get("structure")).endswith("_one_way"):
        return False
    low, high = document["operating_range"]["speed"]
    return bool((low + high) * document["parameters"]["gain"]["value"] < 0)


def _interval(plain: Mapping[str, Any]) -> Rounded:
    return rounded_interval(plain["value"], _ends(plain), plain["unit"])


def _ends(plain: Mapping[str, Any]) -> tuple[float, float]:
    low, high = (math.nan if end is None else end for end in plain["interval"])
    return low, high


def _are_not(words: Sequence[str]) -> str:
    return "aren't" if len(words) > 1 else "isn't"


def _sentence(clause: str) -> str:
    return clause[0].upper() + clause[1:].rstrip() + "."
