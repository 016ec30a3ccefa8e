"""Standard output and standard error, as text that any terminal or file can show."""

from __future__ import annotations

import codecs
import json
import sys
from collections.abc import Mapping
from typing import Any, TextIO

from rich.console import Console

from servobench.core.errors import StorageError

_WIDEST = 110  # characters; longer lines are hard to read
_NARROWEST = 40  # characters; what is narrower breaks figures apart, and wraps in the terminal itself

# How a character is spelled where the output has no place for it, as on a Windows console with its old code page.
_SPELLED = {
    "Ω": "ohm", "ω": "omega", "τ": "tau", "µ": "u", "μ": "u", "°": "deg", "√": "sqrt ", "·": "*",
    "±": "+/-", "−": "-", "–": "-", "—": "-", "…": "...", "→": "->", "•": "-", "✗": "x", "×": "x", "≤": "<=", "≥": ">=",
    "’": "'", "‘": "'", "“": '"', "”": '"', "─": "-",
    "\u00a0": " ", "\u2009": " ", "\u202f": " ",
}  # fmt: skip
_EXPONENT = dict(zip("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789", strict=True))
_BLANKS = "\n\u00a0\u2009\u202f"  # the line's end and the narrow or unbroken blanks between figures


class OutputGone(StorageError):
    """The reader of the output has gone, as after `| head`, so nothing more is printed."""


class _Words(Console):
    """A console for plain sentences: brackets are no markup, and nothing is coloured by guess."""

    def on_broken_pipe(self) -> None:
        """Raise `OutputGone`, which ends the command quietly."""
        raise OutputGone from None


def output() -> Console:
    """Return the console of standard output."""
    return _console(stderr=False)


def messages() -> Console:
    """Return the console of standard error."""
    return _console(stderr=True)


def say(console: Console, line: str) -> None:
    """Print a line as it is, not wrapped: a path in it is to be found again, and copied."""
    console.print(printable(line), soft_wrap=True)


def print_json(data: Mapping[str, Any]) -> None:
    """Print one JSON object on standard output, in ASCII, as no code page can hurt it; raises `OutputGone`."""
    print_text(json.dumps(data, indent=2, allow_nan=False) + "\n")


def print_text(text: str) -> None:
    """Print a text on standard output as it stands; raises `OutputGone`."""
    if sys.stdout is None:  # the process was started without an output
        raise OutputGone
    try:
        sys.stdout.write(text)
        sys.stdout.flush()
    except BrokenPipeError:
        raise OutputGone from None


def printable(text: str) -> str:
    """Return a text without control characters: names from a foreign file must not steer the terminal."""
    return "".join(c if c.isprintable() or c in _BLANKS else ascii(c)[1:-1] for c in text)


def one_line(text: str) -> str:
    """Return a text as `printable` does, on one line: a name with a line end must not look like a line of ours."""
    return printable(text).replace("\n", "\\n")


def spell_what_cannot_be_encoded() -> None:
    """Make standard output and standard error spell out characters that their encoding lacks: `Ω` becomes `ohm`."""
    codecs.register_error("servobench.spelled", _replace_character)
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="servobench.spelled")


def is_terminal(stream: TextIO | None) -> bool:
    """Return whether a stream is a terminal that a person watches."""
    return stream is not None and not stream.closed and stream.isatty()


def _console(*, stderr: bool) -> Console:
    console = _Words(stderr=stderr, markup=False, highlight=False, emoji=False, soft_wrap=False)
    console.width = max(_NARROWEST, min(console.width, _WIDEST))
    return console


def _replace_character(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    places = range(error.start, error.end)
    return "".join(_caret_text(error.object, n) for n in places), error.end


def _caret_text(text: str, n: int) -> str:
    """The spelling of the n-th character of a text: the first of an exponent's begins with `^`, the others go on."""
    digit = _EXPONENT.get(text[n])
    if digit is None:
        return _SPELLED.get(text[n], "?")
    return digit if n and text[n - 1] in _EXPONENT else f"^{digit}"
