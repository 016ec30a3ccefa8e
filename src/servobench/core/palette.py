"""The colours of pictures, by what they stand for, for a light and for a dark ground."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Palette:
    """The colours of a figure, as `#rrggbb`, by what they stand for: text in ink or muted, rules, what was measured, the model.

    `band` is that of an interval about a curve, `shade` that of what lies behind all curves.
    """

    ink: str
    muted: str
    rule: str
    measured: str
    model: str
    band: str
    shade: str


# Light colours for figures that stand alone; a report puts its own in their place, for light and for dark.
LIGHT = Palette(
    ink="#1b2228",
    muted="#56616b",
    rule="#dfe3e6",
    measured="#7f8f9d",
    model="#0b5c9c",
    band="#bcd6ec",
    shade="#f1f3f5",
)

DARK = Palette(
    ink="#e8ebed",
    muted="#a4afb8",
    rule="#2f373e",
    measured="#76838f",
    model="#82bdf2",
    band="#27506f",
    shade="#1e242a",
)
DARK_GROUND = "#14181c"
