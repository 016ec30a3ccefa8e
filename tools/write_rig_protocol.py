"""Write firmware/protocol.h and the tables of docs/reference/rig-protocol.md from the one table; a test holds them equal."""

import sys
from pathlib import Path

from servobench.rig.wire.messages import SECTIONS, Message, Protocol, protocol

ROOT = Path(__file__).resolve().parent.parent
HEADER = ROOT / "firmware" / "protocol.h"
PAGE = ROOT / "docs" / "reference" / "rig-protocol.md"
BEGIN, END = "<!-- tables: begin -->", "<!-- tables: end -->"

_TYPES = {
    "u8": "uint8_t",
    "i8": "int8_t",
    "u16": "uint16_t",
    "i16": "int16_t",
    "u32": "uint32_t",
    "i32": "int32_t",
}
_PREFIXES = {
    "states": "STATE",
    "faults": "FAULT",
    "warnings": "WARNING",
    "reset_causes": "RESET",
    "refusals": "REFUSED",
    "modes": "MODE",
}


def header() -> str:
    """Return the header of the firmware."""
    table = protocol()
    lines = [
        "/* Written by tools/write_rig_protocol.py from protocol.toml: change that, then run `make generate`. */",
        "#ifndef PROTOCOL_H",
        "#define PROTOCOL_H",
        "",
        "#include <stdint.h>",
        "",
        f"#define SCHEMA_HASH 0x{table.schema:08x}UL",
        "",
        *(f"#define {name.upper()} {value}" for name, value in table.constants.items()),
    ]
    for section in SECTIONS:
        prefix = _PREFIXES[section]
        codes = table.codes[section].items()
        lines += ["", *(f"#define {prefix}_{name.upper()} {code}" for name, code in codes)]
    lines += ["", *(f"#define MESSAGE_{each.name.upper()} 0x{each.code:02x}" for each in table.messages)]
    for each in table.messages:
        lines += ["", *_struct(each)]
    return "\n".join([*lines, "", "#endif", ""])


def _struct(message: Message) -> list[str]:
    fields = [
        f"    {_TYPES[field.kind]} {field.name}{f'[{field.count}]' if field.count > 1 else ''};"
        for field in message.fields
    ]
    head = ["typedef struct __attribute__((packed)) {", "    uint8_t code;", "    uint8_t sequence;"]
    return [*head, *fields, f"}} {message.name}_message;"]


def tables() -> str:
    """Return the tables of the page."""
    table = protocol()
    lines = [f"Schema hash: `0x{table.schema:08x}`.", "", "### Constants", ""]
    lines += ["| name | value | meaning |", "| --- | --- | --- |"]
    lines += [
        f"| `{name}` | {value} | {table.meanings[f'constants.{name}']} |"
        for name, value in table.constants.items()
    ]
    for section in SECTIONS:
        lines += [
            "",
            f"### {section.replace('_', ' ').capitalize()}",
            "",
            "| name | code | meaning |",
            "| --- | --- | --- |",
        ]
        lines += [
            f"| `{name}` | {code} | {table.meanings[f'{section}.{name}']} |"
            for name, code in table.codes[section].items()
        ]
    for sender, heading in (("host", "From the host"), ("device", "From the device")):
        lines += ["", f"### {heading}"]
        lines += [line for each in table.messages if each.sender == sender for line in _message(each, table)]
    return "\n".join(lines)


def _message(message: Message, table: Protocol) -> list[str]:
    lines = [
        "",
        f"`{message.name}`, code 0x{message.code:02x}, {message.struct.size} bytes. {message.meaning}",
    ]
    if message.fields:
        lines += ["", "| field | type | meaning |", "| --- | --- | --- |"]
        lines += [
            f"| `{field.name}` | {field.kind}{f'[{field.count}]' if field.count > 1 else ''} | {field.meaning} |"
            for field in message.fields
        ]
    return lines


def page(text: str) -> str:
    """Return the page with its tables renewed."""
    before, _, rest = text.partition(BEGIN)
    _, _, after = rest.partition(END)
    return f"{before}{BEGIN}\n\n{tables()}\n\n{END}{after}"


if __name__ == "__main__":
    HEADER.write_text(header(), encoding="utf-8")
    if not PAGE.is_file():
        sys.exit(f"{PAGE} is missing")
    PAGE.write_text(page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
