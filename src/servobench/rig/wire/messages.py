"""The messages between the host and the open rig, as `protocol.toml` lists them: codes, fields, and the hash of all that."""

from __future__ import annotations

import hashlib
import json
import struct
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any, Literal

from servobench.core.errors import FormatError
from servobench.rig.wire.frames import check16

_FORMATS = {"u8": "B", "i8": "b", "u16": "H", "i16": "h", "u32": "I", "i32": "i"}
SECTIONS = ("states", "faults", "warnings", "reset_causes", "refusals", "modes")
"""The tables of codes, beside constants and messages."""


@dataclass(frozen=True, kw_only=True)
class Field:
    """A field of a message."""

    name: str
    """Its name in `protocol.toml`."""
    kind: str
    """Its type, `u8` to `i32`."""
    count: int
    """The number of them."""
    meaning: str
    """Its meaning, for people."""

    @property
    def format(self) -> str:
        """The field in the language of `struct`."""
        return f"{self.count if self.count > 1 else ''}{_FORMATS[self.kind]}"


@dataclass(frozen=True, kw_only=True)
class Message:
    """A kind of message."""

    name: str
    """Its name in `protocol.toml`."""
    code: int
    """The first byte of its payload."""
    sender: Literal["host", "device"]
    """The sender."""
    meaning: str
    """Its effect, for people."""
    fields: tuple[Field, ...]
    """The fields behind the code and the sequence number (`u8` both)."""

    @property
    def checked(self) -> bool:
        """Whether it ends with a second checksum, `check`, of what stands before."""
        return any(field.name == "check" for field in self.fields)

    @property
    def struct(self) -> struct.Struct:
        """Its payload: little-endian, without padding."""
        return _struct(self)

    def pack(self, sequence: int, **values: Any) -> bytes:
        """Return the payload with a sequence number and a value (a list for several) for each field; `check` comes by itself.

        >>> protocol().message("duty").pack(7, owner=1, duty=-2).hex(" ")
        '07 07 01 00 fe ff e9 0e'
        """
        numbers: list[int] = []
        if self.checked and "check" not in values:
            return (unchecked := self.pack(sequence, check=0, **values)[:-2]) + check16(unchecked).to_bytes(
                2, "little"
            )
        for field in self.fields:
            value = values.pop(field.name)
            numbers += value if field.count > 1 else [value]
        if values:
            raise TypeError(f"{self.name} has no fields {', '.join(values)}")
        return self.struct.pack(self.code, sequence & 0xFF, *numbers)

    def unpack(self, payload: bytes) -> dict[str, Any]:
        """Return the values of a payload by the fields' names, `sequence` included. Raises `FormatError` for another length."""
        if len(payload) != self.struct.size:
            raise FormatError(
                f"a {self.name} of {len(payload)} bytes; expected {self.struct.size}: host and firmware differ; flash it again"
            )
        _, sequence, *numbers = self.struct.unpack(payload)
        values: dict[str, Any] = {"sequence": sequence}
        place = 0
        for field in self.fields:
            values[field.name] = (
                numbers[place] if field.count == 1 else tuple(numbers[place : place + field.count])
            )
            place += field.count
        return values


@cache
def _struct(message: Message) -> struct.Struct:
    return struct.Struct("<BB" + "".join(field.format for field in message.fields))


@dataclass(frozen=True, kw_only=True)
class Protocol:
    """All that host and firmware have to agree on."""

    constants: Mapping[str, int]
    """Numbers that both compute with, by their names."""
    codes: Mapping[str, Mapping[str, int]]
    """For each of `SECTIONS` the codes by their names."""
    meanings: Mapping[str, str]
    """The meaning of each, by `section.name`."""
    messages: tuple[Message, ...]
    """All messages there are."""
    schema: int
    """The hash that both must have: the first four bytes of SHA-256 over everything but the meanings."""

    def message(self, name: str) -> Message:
        """Return the message of that name; raises `KeyError` for none."""
        return {each.name: each for each in self.messages}[name]

    def of(self, payload: bytes) -> Message | None:
        """Return which message a payload is, or None for an unknown code."""
        return next((each for each in self.messages if payload[:1] == bytes([each.code])), None)

    def names(self, section: str, bits: int) -> tuple[str, ...]:
        """Return the names of the bits that are set.

        >>> protocol().names("faults", 3)
        ('watchdog', 'stall')
        """
        return tuple(name for name, code in self.codes[section].items() if bits & code)


@cache
def protocol() -> Protocol:
    """Return the protocol of `protocol.toml`."""
    table = tomllib.loads(files("servobench.rig.wire").joinpath("protocol.toml").read_text(encoding="utf-8"))
    messages = tuple(_message(name, each) for name, each in table["messages"].items())
    constants = {name: each["value"] for name, each in table["constants"].items()}
    codes = {section: {name: each["code"] for name, each in table[section].items()} for section in SECTIONS}
    meanings = {
        f"{section}.{name}": each["meaning"]
        for section in ("constants", *SECTIONS)
        for name, each in table[section].items()
    }
    return Protocol(
        constants=constants,
        codes=codes,
        meanings=meanings,
        messages=messages,
        schema=_hash(constants, codes, messages),
    )


def _message(name: str, table: Mapping[str, Any]) -> Message:
    return Message(
        name=name,
        code=table["code"],
        sender=table["from"],
        meaning=table["meaning"],
        fields=tuple(_field(*row) for row in table["fields"]),
    )


def _field(name: str, kind: str, meaning: str) -> Field:
    base, _, count = kind.rstrip("]").partition("[")
    return Field(name=name, kind=base, count=int(count or 1), meaning=meaning)


def _hash(
    constants: Mapping[str, int], codes: Mapping[str, Mapping[str, int]], messages: tuple[Message, ...]
) -> int:
    layout = [
        [each.name, each.code, each.sender, [[f.name, f.kind, f.count] for f in each.fields]]
        for each in messages
    ]
    text = json.dumps([constants, codes, layout], sort_keys=True, separators=(",", ":"))
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:4], "little")
