"""In which line of a TOML file a key stands; Python's reader gives values only."""

from __future__ import annotations

import re
import tomllib
from bisect import bisect_right
from collections.abc import Mapping
from typing import TypeAlias

Path: TypeAlias = tuple[str | int, ...]
"""The place of a value: the keys that lead to it, and for an element of an array its index."""

_BLANK = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")
_SPACE = re.compile(r"[ \t]*")
_KEY = re.compile(r"""[A-Za-z0-9_-]+|"(?:\\.|[^"\\\n])*"|'[^'\n]*'""")
_STRING = re.compile(
    # A text in three quotes may end with one or two more, which belong to it.
    r'''"""(?:[^\\]|\\.)*?""""{0,2}|"(?:\\.|[^"\\\n])*"|''' + r"""'''[\s\S]*?''''{0,2}|'[^'\n]*'""",
    re.DOTALL,
)
_PLAIN = re.compile(r"[^,\]}#\n]*")


def lines_of_keys(text: str) -> dict[Path, int]:
    """Return the line, counted from 1, of each key, table and array element in a TOML text that `tomllib` can read."""
    return _Scanner(text.replace("\r\n", "\n")).scan()


def line_of(path: Path, lines: Mapping[Path, int]) -> int | None:
    """Return the line of a key, or of the nearest table around it where the key isn't there; None where there is neither."""
    return next((lines[path[:n]] for n in range(len(path), 0, -1) if path[:n] in lines), None)


class _Scanner:
    """Walks once through a text that is known to be valid, so it needs to tell only where each thing ends."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.at = 0
        self.line_starts = [0, *(match.end() for match in re.finditer("\n", text))]
        self.lines: dict[Path, int] = {}
        self.elements: dict[Path, int] = {}
        """The number of elements of each array of tables so far."""

    def scan(self) -> dict[Path, int]:
        table: Path = ()
        while self._skip(_BLANK) < len(self.text):
            if self.text[self.at] == "[":
                table = self._header()
            else:
                self._pair(table)
        return self.lines

    def _skip(self, pattern: re.Pattern[str]) -> int:
        match = pattern.match(self.text, self.at)
        self.at = match.end() if match else self.at
        return self.at

    def _note(self, path: Path) -> None:
        """Note the line of a path, and of its parents that appear here first."""
        line = bisect_right(self.line_starts, self.at)
        for n in range(1, len(path) + 1):
            self.lines.setdefault(path[:n], line)

    def _header(self) -> Path:
        """`[a.b]` or `[[a.b]]`; returns the table that it opens."""
        brackets = 2 if self.text.startswith("[[", self.at) else 1
        start = self.at
        self.at += brackets
        path: Path = ()
        keys = self._keys()
        for key in keys[:-1]:
            path = self._last_element((*path, key))
        path = (*path, keys[-1])
        if brackets == 2:
            self.elements[path] = self.elements.get(path, 0) + 1
        path = self._last_element(path)
        end, self.at = self.at, start
        self._note(path)
        self.at = end + brackets
        return path

    def _last_element(self, path: Path) -> Path:
        """The element of an array of tables that a header refers to; a path that is no such array stays."""
        return (*path, self.elements[path] - 1) if path in self.elements else path

    def _keys(self) -> list[str]:
        """A key with its dots, and the space around it."""
        keys = []
        while True:
            self._skip(_SPACE)
            start = self.at
            raw = self.text[start : self._skip(_KEY)]
            keys.append(tomllib.loads(f"key = {raw}")["key"] if raw[0] in "\"'" else raw)
            self._skip(_SPACE)
            if not self.text.startswith(".", self.at):
                return keys
            self.at += 1

    def _pair(self, table: Path) -> None:
        """`key = value`."""
        start = self.at
        path = (*table, *self._keys())
        end, self.at = self.at, start
        self._note(path)
        self.at = end + 1  # the equals sign
        self._skip(_SPACE)
        self._value(path)

    def _value(self, path: Path) -> None:
        opening = self.text[self.at]
        if opening in "\"'":
            self._skip(_STRING)
        elif opening == "[":
            self._array(path)
        elif opening == "{":
            self._inline_table(path)
        else:
            self._skip(_PLAIN)

    def _array(self, path: Path) -> None:
        self.at += 1
        index = 0
        while self.text[self._skip(_BLANK)] != "]":
            self._note((*path, index))
            self._value((*path, index))
            index += 1
            if self.text[self._skip(_BLANK)] == ",":
                self.at += 1
        self.at += 1

    def _inline_table(self, path: Path) -> None:
        self.at += 1
        while self.text[self._skip(_BLANK)] != "}":
            self._pair(path)
            if self.text[self._skip(_BLANK)] == ",":
                self.at += 1
        self.at += 1
