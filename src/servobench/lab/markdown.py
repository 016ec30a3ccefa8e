"""Markdown with formulas as HTML that a page may hold, and as text: what is neither is shown as it is, and nothing is fetched."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

from servobench.core.errors import FormatError
from servobench.lab.formula import formula_html, formula_text

if TYPE_CHECKING:
    from markdown_it import MarkdownIt
    from markdown_it.rules_inline import StateInline
    from markdown_it.token import Token

_FORMULA, _SHOWN = "formula", "formula_shown"
_ALONE = "dollar signs that begin no formula"
_LINE = "\n"
_BEGUN = re.compile(r"[^\W\d_]|[\\(√]")
_LONGEST_BEGUN = 20  # characters of an unterminated formula that are quoted
_BEFORE_MARK = re.compile(r"(<math (?:(?!</?math\b).)*</math>[,.;:?!)]+)")


def to_html(text: str) -> str:
    """Return Markdown (CommonMark, tables and formulas) as HTML without scripts, styles, pictures or any tag of the writer's own.

    A formula stands between dollar signs, `$K/(τs + 1)$`, or between two of them to be shown larger. HTML in the text comes
    out as text. Links lead to `http`, `https` and `mailto` addresses or within the page, others stay text.
    Raises `FormatError` for a formula that can't be read.
    """
    reader = _reader().disable("image")
    reader.add_render_rule(_FORMULA, _render)
    reader.add_render_rule(_SHOWN, _render)
    tokens = reader.parse(text)
    for token in tokens:
        token.attrs.pop("style", None)  # the alignment of a column; a page's policy forbids styles in tags
        for inner in token.children or ():
            if inner.type == "link_open":
                inner.attrSet("rel", "noopener noreferrer")
    html = str(reader.renderer.render(tokens, reader.options, {}))
    return _BEFORE_MARK.sub(
        r'<span class="kept">\1</span>', html
    )  # no line ends between a formula and its comma


def as_text(text: str) -> list[Token]:
    """Return Markdown's tokens with the formulas as plain text, for what sets Markdown in a terminal."""
    tokens = _reader().enable("strikethrough").parse(text)
    for token in tokens:
        for inner in token.children or ():
            if inner.type in (_FORMULA, _SHOWN):
                inner.type, inner.content = "text", formula_text(inner.content)
    return tokens


def check_formulas(text: str, first: int, source: str) -> None:
    """Raise `FormatError`, with the file and its line, for a formula that can't be read or has no end.

    The text begins in the line `first`.
    """
    environment: dict[str, list[str]] = {_ALONE: []}
    for token in _reader().parse(text, environment):
        for inner in token.children or ():
            if inner.type in (_FORMULA, _SHOWN):
                _check(inner.content, text, first, source)
    for begun in environment[_ALONE][:1]:
        line = first + text.partition(begun)[0].count("\n")
        raise FormatError(
            f"{source}:{line}: the formula that begins with `{begun.partition(_LINE)[0]}` has no end; expected $...$ with no "
            "blank inside either of the signs; a dollar sign by itself is \\$"
        )


def _check(formula: str, text: str, first: int, source: str) -> None:
    try:
        formula_html(formula)
    except FormatError as error:
        line = first + text.partition(f"${formula}$")[0].count("\n")
        raise FormatError(f"{source}:{line}: {error}") from None


def _reader() -> MarkdownIt:
    from markdown_it import MarkdownIt

    reader = MarkdownIt("commonmark", {"html": False}).enable("table")
    reader.inline.ruler.before("escape", _FORMULA, _formula)
    return reader


def _formula(state: StateInline, silent: bool) -> bool:
    """Take `$...$` or `$$...$$` for a formula; a dollar sign beside a blank, or before a digit at its end, is a sum of money."""
    if state.src[state.pos] != "$":
        return False
    marks = "$$" if state.src.startswith("$$", state.pos) else "$"
    first = state.pos + len(marks)
    if not _is_formula(state.src, first, marks):
        # A sum of money begins with a digit; what begins with a letter was meant as a formula.
        if _ALONE in state.env and _BEGUN.match(state.src, first):
            state.env[_ALONE].append(state.src[state.pos : first + _LONGEST_BEGUN])
        return False
    last = state.src.find(marks, first)
    if not silent:
        token = state.push(_SHOWN if len(marks) > 1 else _FORMULA, "math", 0)
        token.content = state.src[first:last]
    state.pos = last + len(marks)
    return True


def _is_formula(text: str, first: int, marks: str) -> bool:
    """Whether a formula begins at `first` and is ended by such marks, with no blank inside them; `$5` isn't one, nor is code."""
    last = text.find(marks, first)
    after = last + len(marks)
    if (
        last <= first
        or text[first].isspace()
        or text[last - 1].isspace()
        or text[after : after + 1].isdigit()
    ):
        return False
    return "`" not in text[first:last]  # there the second sign stands in code


def _render(_: object, tokens: Sequence[Token], at: int, *__: object) -> str:
    token = tokens[at]
    if token.type == _FORMULA:
        return formula_html(token.content)
    return f'<span class="shown">{formula_html(token.content, display=True)}</span>'
