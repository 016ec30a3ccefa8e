"""Inline SVG out of Matplotlib figures: text stays text, colours follow the page, and the same figure gives the same bytes."""

from __future__ import annotations

import re
from dataclasses import fields
from html import escape
from io import StringIO
from typing import TYPE_CHECKING

from servobench.report.palette import Palette

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Colours that stand for the page's variables. A figure is drawn in them; each becomes `var(--name)`.
PLACEHOLDERS = Palette(
    **{colour.name: f"#0a{number:02x}fe" for number, colour in enumerate(fields(Palette), start=1)}
)

_NUMBER = re.compile(r"-?\d+\.\d+")
_ID = re.compile(r' id="([^"]*)"')
_REFERENCE = re.compile(r'(?:url\(#|href="#)([^")]*)')
_SETTINGS = {"svg.fonttype": "none", "svg.hashsalt": "servobench", "svg.id": None, "path.simplify": True}


def inline_svg(figure: Figure, *, name: str, title: str, description: str) -> str:
    """Return a figure drawn in `PLACEHOLDERS` as an `<svg>` element for a page.

    It scales with the page, has no address, script or style sheet in it, and is an image with the title and the description for
    who can't see it. All its ids begin with `name`, which must be unique on the page.
    """
    drawing = _rendered(figure)
    body = drawing[drawing.index(">", drawing.index("<svg")) + 1 : drawing.rindex("</svg>")]
    body = re.sub(r"<metadata>.*?</metadata>|<style[^>]*>.*?</style>|<!--.*?-->", "", body, flags=re.DOTALL)
    body = body.replace("xlink:href=", "href=").replace("<defs>\n </defs>", "")
    body = _in_variables(_with_page_fonts(_shorter(_with_own_ids(body, name))))
    width, height = (float(side) * 72 for side in figure.get_size_inches())
    return (
        f'<svg viewBox="0 0 {width:g} {height:g}" width="{width:g}" height="{height:g}" role="img" '
        f'aria-labelledby="{name}-title {name}-description">'
        f'<title id="{name}-title">{escape(title)}</title>'
        f'<desc id="{name}-description">{escape(description)}</desc>'
        f"{body.strip()}</svg>"
    )


def _rendered(figure: Figure) -> str:
    import matplotlib
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    out = StringIO()
    known = {key: value for key, value in _SETTINGS.items() if key in matplotlib.rcParams}
    with matplotlib.rc_context(known):
        FigureCanvasSVG(figure).print_svg(out, metadata={"Date": None, "Creator": None})
    return out.getvalue()


def _with_own_ids(body: str, name: str) -> str:
    """The same with short ids of its own where something refers to them, and without the others."""
    used = sorted(set(_REFERENCE.findall(body)))
    new = {old: f"{name}-{number}" for number, old in enumerate(used)}
    body = _ID.sub(lambda match: f' id="{new[match[1]]}"' if match[1] in new else "", body)
    return _REFERENCE.sub(lambda match: match[0].replace(f"#{match[1]}", f"#{new[match[1]]}"), body)


def _shorter(body: str) -> str:
    """The same with a hundredth of a pixel as the smallest step, and without indentation."""
    body = _NUMBER.sub(lambda match: f"{float(match[0]):.2f}".rstrip("0").rstrip(".").replace("-0", "-0") or "0", body)
    return re.sub(r"\s*\n\s*", "\n", body)


def _with_page_fonts(body: str) -> str:
    """The same in the font of the page: the style sheet names it, the drawing the size and the weight."""
    body = re.sub(r"font: (?:(bold|700) )?([\d.]+px) [^;\"]*", _font, body)
    return re.sub(r"font-family: [^;\"]*;?", "", body)


def _font(match: re.Match[str]) -> str:
    weight = "font-weight: 600; " if match[1] else ""
    return f"{weight}font-size: {match[2]}"


def _in_variables(body: str) -> str:
    """The same with the page's variables in place of the colours that stand for them."""
    for colour in fields(Palette):
        body = body.replace(getattr(PLACEHOLDERS, colour.name), f"var(--{colour.name})")
    return body
