"""Formulas as people write them in a line, `K/(τs + 1)`, set as MathML, and as text for a terminal.

The notation is a small part of UnicodeMath (Sargent 2016, Unicode Technical Note 28). Letters and signs stand for themselves,
`_` sets an index, `^` an exponent (² will do as well), `/` divides, `√` takes what follows, and brackets keep together; those
that do no more than that vanish. Latin letters in a row are one name, such as `kp`; a Greek letter is a name by itself. A blank
between two names multiplies, and ends what a `/` takes: `J dΩ/dt` is J times a fraction. Words stand between quotation marks.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING

from servobench.core.errors import FormatError

if TYPE_CHECKING:
    from markupsafe import Markup

_FUNCTIONS = {"arcsin", "arctan", "cos", "exp", "lg", "lim", "ln", "log", "max", "min", "sin", "tan"}
_CLOSING = {"(": ")", "[": "]", "|": "|"}
_OPERATORS = "+−±=<>≤≥≈≠→·×,;:%…"
_ABOVE = dict(zip("⁰¹²³⁴⁵⁶⁷⁸⁹⁺⁻ⁿ", "0123456789+−n", strict=True))
_RAISED = {below: above for above, below in _ABOVE.items()}
_LOWERED = dict(
    zip("0123456789+−=aehijklmnoprstuvxβγρφχ", "₀₁₂₃₄₅₆₇₈₉₊₋₌ₐₑₕᵢⱼₖₗₘₙₒₚᵣₛₜᵤᵥₓᵦᵧᵨᵩᵪ", strict=True)
)
_TIMES, _OF = "\u2062", "\u2061"  # what is said and not seen: multiplied by, function of
_TIGHT, _THIN, _WIDE = "0.08em", "0.17em", "0.6em"

_TOKEN = re.compile(
    r"""(?P<blank>\s+) | (?P<number>[0-9]+(?:\.[0-9]+)?) | (?P<name>[A-Za-z]+|[Α-Ωα-ω∞]) | (?P<word>"[^"]*")
    | (?P<above>[⁰¹²³⁴⁵⁶⁷⁸⁹⁺⁻ⁿ]+) | (?P<sign>[-_^/√()\[\]|+−±=<>≤≥≈≠→·×,;:%…])""",
    re.VERBOSE,
)
_INDEX, _EXPONENT = (re.compile(rf"{sign}(?:([A-Za-z]+|[α-ω]|[0-9]+)|\(([^()]*)\))") for sign in ("_", r"\^"))
_INDEXED = re.compile(
    r"((?<![A-Za-z0-9_`>])[A-Za-z]|(?<![A-Za-z_`>])[Α-Ωα-ω])_([A-Za-z0-9]+)(?![A-Za-z0-9_])"
)


@dataclass(frozen=True, kw_only=True)
class _Token:
    kind: str
    text: str
    is_apart: bool  # a blank stands before it


@dataclass(frozen=True, kw_only=True)
class _Part:
    """A piece of a formula as MathML; `kind` tells operators, names, functions, fractions and the d of a derivative."""

    mathml: str
    kind: str = "other"
    is_apart: bool = False
    inner: str = ""  # what stands in the brackets, of a part in round ones


def formula_html(source: str, *, display: bool = False) -> str:
    """Return a formula as a `<math>` element; with `display` its fractions have a bar, else a stroke, as a line needs.

    Raises `FormatError`, which says what can't be read in the formula.
    """
    parts = _Reader(source, display).whole()
    style = ' display="block"' if display else ""
    return f'<math{style} alttext="{escape(formula_text(source))}">{parts}</math>'


def formula_text(source: str) -> str:
    """Return a formula as a line of text: indices and exponents as small letters, where there are such, and words unquoted."""
    text = _INDEX.sub(lambda match: _subscript(match[1] or match[2]), source)
    text = _EXPONENT.sub(lambda match: _superscript(match[1] or match[2]), text)
    return " ".join(text.replace('"', "").replace("-", "−").split())


def line_html(text: str) -> Markup:
    """Return a line of plain text, or one that is HTML already, as HTML with the indices of letters set, such as `ω_n`."""
    from markupsafe import Markup, escape

    whole = str(escape(text))
    return Markup(_INDEXED.sub(r"<i>\1</i><sub>\2</sub>", whole))


def line_text(text: str) -> str:
    """Return a line of plain text with indices as small letters, where there are such: `ω_n` as ωₙ."""
    return _INDEXED.sub(lambda match: match[1] + _subscript(match[2]), text)


def _subscript(index: str) -> str:
    if all(letter in _LOWERED for letter in index):
        return "".join(_LOWERED[letter] for letter in index)
    return f"_{index}" if index.isalnum() else f"_({index})"


def _superscript(exponent: str) -> str:
    plain = exponent.replace("-", "−")
    if all(letter in _RAISED for letter in plain):
        return "".join(_RAISED[letter] for letter in plain)
    return f"^{exponent}" if exponent.isalnum() else f"^({exponent})"


class _Reader:
    """Reads one formula from left to right; where it can't go on it says which formula, and why."""

    def __init__(self, source: str, display: bool) -> None:
        self._source = source
        self._display = display
        self._tokens = list(self._fraction_tokens())
        self._at = 0

    def whole(self) -> str:
        """The MathML of all of it."""
        if not self._tokens:
            raise FormatError("there is an empty formula; expected one such as $K/(τs + 1)$")
        return _join(self._parts(until=""))

    def _fraction_tokens(self) -> Iterator[_Token]:
        at, apart = 0, False
        while at < len(self._source):
            match = _TOKEN.match(self._source, at)
            if match is None:
                raise self._wrong(
                    f"{self._source[at]!r} has no meaning in a formula; words go between quotation marks"
                )
            at = match.end()
            kind = match.lastgroup or ""
            if kind != "blank":
                yield _Token(
                    kind=kind, text=match[0].replace("-", "−") if kind == "sign" else match[0], is_apart=apart
                )
            apart = kind == "blank"

    def _wrong(self, why: str) -> FormatError:
        return FormatError(f"the formula ${self._source}$ can't be read: {why}")

    def _next(self) -> _Token | None:
        return self._tokens[self._at] if self._at < len(self._tokens) else None

    def _takes(self, sign: str) -> bool:
        """Whether the next token is that sign, which is passed over then."""
        token = self._next()
        if token is None or token.kind != "sign" or token.text != sign:
            return False
        self._at += 1
        return True

    def _parts(self, until: str) -> list[_Part]:
        """All up to a closing bracket, or the end."""
        parts: list[_Part] = []
        while (token := self._next()) is not None and not (token.kind == "sign" and token.text == until):
            if token.kind == "sign" and token.text in _OPERATORS:
                self._at += 1
                parts.append(_Part(mathml=_mo(token.text), kind="operator", is_apart=token.is_apart))
            elif token.kind == "sign" and token.text == "/":
                self._at += 1
                self._divide(parts)
            else:
                parts.append(self._factor())
        if until and not self._takes(until):
            raise self._wrong(f"expected {until!r} at its end")
        if not parts:
            raise self._wrong("there is nothing between two brackets")
        return parts

    def _divide(self, parts: list[_Part]) -> None:
        """Put the text before a `/`, back to a blank, over the text after it, up to the next."""
        above = _take_numerator(parts)
        below = [self._factor()] if self._starts_factor() else []
        while below and self._starts_factor() and not self._tokens[self._at].is_apart:
            below.append(self._factor())
        if not above or not below:
            raise self._wrong("expected something on both sides of '/'")
        following = self._next()
        if following is not None and following.text in "/·" and not following.is_apart:
            raise self._wrong("the order of two divisions or products is ambiguous; add brackets")
        if self._display:
            bar = f"<mfrac>{_without_brackets(above)}{_without_brackets(below)}</mfrac>"
            parts.append(_Part(mathml=bar, kind="fraction", is_apart=above[0].is_apart))
        else:
            parts += [*above, _Part(mathml=_mo("/"), kind="operator"), *below]

    def _starts_factor(self) -> bool:
        token = self._next()
        return token is not None and (
            token.kind in ("number", "name", "word") or token.text in ("√", "(", "[", "|")
        )

    def _factor(self) -> _Part:
        """A name, a number, a word, a root or a bracket, with its index and its exponent."""
        base = self._primary()
        below = above = ""
        while (token := self._next()) is not None and not token.is_apart:
            if not below and self._takes("_"):
                below = self._script()
            elif not above and self._takes("^"):
                above = self._script()
            elif not above and token.kind == "above":
                self._at += 1
                above = _as_exponent(token.text)
            else:
                break
        if not (below or above):
            return base
        tag = "msubsup" if below and above else "msub" if below else "msup"
        return _Part(
            mathml=f"<{tag}>{base.mathml}{below}{above}</{tag}>", kind=base.kind, is_apart=base.is_apart
        )

    def _is_scripted(self) -> bool:
        token = self._next()
        return token is not None and not token.is_apart and (token.kind == "above" or token.text in "_^")

    def _script(self) -> str:
        part = self._primary()
        return part.inner or part.mathml

    def _primary(self) -> _Part:
        token = self._next()
        if token is None:
            raise self._wrong("it ends too early")
        self._at += 1
        if token.kind == "number":
            return _Part(mathml=_mn(token.text), is_apart=token.is_apart)
        if token.kind == "name":
            return self._name(token)
        if token.kind == "word":
            return _Part(mathml=f"<mtext>{escape(token.text[1:-1])}</mtext>", is_apart=token.is_apart)
        if token.text == "√":
            taken = self._script()
            return _Part(mathml=f"<msqrt>{taken}</msqrt>", is_apart=token.is_apart)
        if token.text in _CLOSING:
            closing = _CLOSING[token.text]
            parts = self._parts(until=closing)
            inner = _join(parts)
            if (
                token.text == "("
                and parts[0].kind == "fraction"
                and len(parts) == 1
                and not self._is_scripted()
            ):
                return _Part(mathml=inner, is_apart=token.is_apart, inner=inner)  # its bar keeps it together
            whole = _row([_mo(token.text, "prefix"), inner, _mo(closing, "postfix")])
            return _Part(mathml=whole, is_apart=token.is_apart, inner=inner if token.text == "(" else "")
        raise self._wrong(f"{token.text!r} can't stand there")

    def _name(self, token: _Token) -> _Part:
        text, following = token.text, self._next()
        if text in _FUNCTIONS:
            return _Part(mathml=_mi(text), kind="function", is_apart=token.is_apart)
        upright = '<mi mathvariant="normal">d</mi>'
        if text == "d" and following is not None and following.kind == "name" and not following.is_apart:
            return _Part(mathml=upright, kind="differential", is_apart=token.is_apart)
        if len(text) == 2 and text[0] == "d":  # dt, of a derivative
            return _Part(mathml=_row([upright, _mi(text[1])]), is_apart=token.is_apart)
        return _Part(mathml=_mi(text), kind="name", is_apart=token.is_apart)


def _take_numerator(parts: list[_Part]) -> list[_Part]:
    """The numerator of a `/`, taken off the end: back to a blank, an operator that isn't a point, or the beginning."""
    first = len(parts)
    while first and (parts[first - 1].kind != "operator" or parts[first - 1].mathml == _mo("·")):
        first -= 1
        if parts[first].is_apart:
            break
    above = parts[first:]
    del parts[first:]
    return above


def _join(parts: list[_Part]) -> str:
    """Parts side by side; what multiplies and what a function takes is said to who hears the formula."""
    texts: list[str] = []
    for before, part in zip([None, *parts], parts, strict=False):
        if (
            before is not None
            and "operator" not in (before.kind, part.kind)
            and before.kind != "differential"
        ):
            is_function = before.kind == "function" or (
                before.kind == "name" and part.inner and not part.is_apart
            )
            texts.append(_mo(_OF if is_function else _TIMES))
            if part.is_apart:
                texts.append(f'<mspace width="{_THIN}"></mspace>')
        elif before is not None and before.mathml == _mo(",") and part.is_apart:
            texts.append(f'<mspace width="{_WIDE}"></mspace>')
        texts.append(part.mathml)
    return _row(texts)


def _without_brackets(parts: list[_Part]) -> str:
    """A numerator or denominator without a bracket around all of it, which a bar makes unnecessary."""
    return (parts[0].inner or parts[0].mathml) if len(parts) == 1 else _join(parts)


def _as_exponent(above: str) -> str:
    """Small raised letters as an exponent, the digits of a number together."""
    pieces = re.findall(r"\d+|\D", "".join(_ABOVE[letter] for letter in above))
    return _row(
        [_mn(text) if text.isdigit() else _mo(text) if text in "+−" else _mi(text) for text in pieces]
    )


def _row(parts: list[str]) -> str:
    return parts[0] if len(parts) == 1 else f"<mrow>{''.join(parts)}</mrow>"


def _mi(text: str) -> str:
    return f"<mi>{escape(text)}</mi>"


def _mn(text: str) -> str:
    return f"<mn>{escape(text)}</mn>"


def _mo(text: str, form: str = "") -> str:
    spaced = f' lspace="{_TIGHT}" rspace="{_TIGHT}"' if text in "/·" else f' form="{form}"' if form else ""
    return f"<mo{spaced}>{escape(text)}</mo>"
