"""Markdown to HTML that a page may hold: what isn't Markdown is shown as it is written, and nothing is fetched."""

from __future__ import annotations


def to_html(text: str) -> str:
    """Return Markdown (CommonMark, and tables) as HTML without scripts, styles, pictures or any tag of the writer's own.

    HTML in the text comes out as text. Links lead to `http`, `https` and `mailto` addresses or within the page, others stay text.
    """
    from markdown_it import MarkdownIt

    reader = MarkdownIt("commonmark", {"html": False}).enable("table").disable("image")
    tokens = reader.parse(text)
    for token in tokens:
        token.attrs.pop("style", None)  # the alignment of a column; a page's policy forbids styles in tags
        for inner in token.children or ():
            if inner.type == "link_open":
                inner.attrSet("rel", "noopener noreferrer")
    return str(reader.renderer.render(tokens, reader.options, {}))
