"""A setting's field is of the type that the setting's own model says, whatever its default."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import pytest
from pydantic import Field

from servobench.core.settings import Settings, Voltage
from servobench.panel.catalogue import catalogue, field_of


class Every(Settings):
    """One setting of each type."""

    file: Path
    """A path."""
    port: str
    """A text that is required."""
    label: str | None = None
    """A text that may be left out."""
    folder: Path | None = None
    """A path that may be left out."""
    which: str | Annotated[int, Field(ge=0)] = 0
    """A name or a number."""
    limit: Voltage | None = None
    """A number that may be left out [V]."""
    count: int = 3
    """A whole number."""
    flag: bool | None = None
    """A truth that may be left out."""
    levels: tuple[float, ...] = ()
    """Numbers, none by default."""
    bits: Literal[16, 24] | None = None
    """One of some numbers."""
    more: dict[str, float] = Field(default_factory=dict)
    """A table."""


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("file", "text"),
        ("port", "text"),
        ("label", "text"),
        ("folder", "text"),
        ("which", "number or text"),
        ("limit", "number"),
        ("count", "number"),
        ("flag", "truth"),
        ("levels", "numbers"),
        ("bits", "number"),
        ("more", "table"),
    ],
)
def test_the_type_is_that_of_the_annotation(name: str, expected: str) -> None:
    assert field_of(name, Every.model_fields[name])["type"] == expected


def test_the_paths_and_names_of_devices_are_texts() -> None:
    devices = {
        each["name"]: {field["name"]: field for field in each["fields"]} for each in catalogue()["devices"]
    }

    assert devices["replay"]["file"]["type"] == "text"
    assert devices["replay"]["recording"]["type"] == "number or text"
    assert [devices["assigned"][name]["type"] for name in ("secret", "exercise", "student")] == 3 * ["text"]
    assert devices["twin"]["resistance"]["type"] == "number"
