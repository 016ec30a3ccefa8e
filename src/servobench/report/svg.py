"""Inline SVG from Matplotlib figures: text stays text, colours follow the page, and equal figures give equal bytes."""

from __future__ import annotations

import re
import warnings
from collections.abc import Mapping
from dataclasses import fields
from html import escape
from io import StringIO
from typing import TYPE_CHECKING, Any

from servobench.core.palette import Palette
from servobench.report.ticks import take_ticks

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Colours that stand for the page's variables. A figure is drawn in them; each becomes `var(--name)`.
PLACEHOLDERS = Palette(
    **{colour.name: f"#0a{number:02x}fe" for number, colour in enumerate(fields(Palette), start=1)}
)
_VARIABLES = {getattr(PLACEHOLDERS, colour.name): f"var(--{colour.name})" for colour in fields(Palette)}

_ASIDE = re.compile(
    r"<metadata>.*?</metadata>|<style[^>]*>.*?</style>|<!--.*?-->|<defs>\s*</defs>", re.DOTALL
)
_TAG = re.compile(r"<[^>]*>")  # a text of a user's in the drawing has no bare < or >
_FURTHER_DIGITS = re.compile(r"(?<=\.\d\d)\d+")
_LAST_ZERO = re.compile(r"(?<=\.\d)0(?!\d)|\.0+(?!\d)")
_ID = re.compile(r' id="([^"]*)"')
_REFERENCE = re.compile(r'(?:url\(|href=")#([^")]*)')
_FONT = re.compile(r"font: (?:(bold|700) )?([\d.]+px) [^;\"]*")
_NEEDLESS = re.compile(r' font-family: [^;"]*;?| transform="rotate\(-?0 [^"]*"')
_SETTINGS: Any = {"svg.fonttype": "none", "svg.hashsalt": "servobench", "path.simplify": True}


def inline_svg(figure: Figure, *, name: str, title: str, description: str) -> str:
    """Return a figure drawn in `PLACEHOLDERS` as an `<svg>` element for a page.

    It scales with the page, has no address, script or style sheet in it, and is an image with the title and the description for
    who can't see it. All its ids begin with `name`, which must be unique on the page.
    """
    ticks = take_ticks(figure)
    drawing = _render(figure)
    body = ticks + drawing[drawing.index(">", drawing.index("<svg")) + 1 : drawing.rindex("</svg>")]
    body = _ASIDE.sub("", body)
    referred = sorted({old for tag in _TAG.findall(body) for old in _REFERENCE.findall(tag)})
    ids = {old: f"{name}-{number}" for number, old in enumerate(referred)}
    body = _TAG.sub(lambda tag: _rewrite_tag(tag[0], ids), body)
    body = re.sub(r"\s*\n\s*", "\n", body)
    width, height = (float(side) * 72 for side in figure.get_size_inches())
    return (
        f'<svg viewBox="0 0 {width:g} {height:g}" width="{width:g}" height="{height:g}" role="img" '
        f'aria-labelledby="{name}-title {name}-description">'
        f'<title id="{name}-title">{escape(title)}</title>'
        f'<desc id="{name}-description">{escape(description)}</desc>'
        f"{body.strip()}</svg>"
    )


def _render(figure: Figure) -> str:
    import matplotlib
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    out = StringIO()
    canvas: Any = FigureCanvasSVG(figure)
    with matplotlib.rc_context(_SETTINGS), warnings.catch_warnings():
        # The text is set by the browser, in fonts of its own.
        warnings.filterwarnings("ignore", message="Glyph .* missing from")
        canvas.print_svg(out, metadata={"Date": None, "Creator": None})
    return out.getvalue()


def _rewrite_tag(tag: str, ids: Mapping[str, str]) -> str:
    """A tag with ids of the page's own, or none where nothing refers to it, and with the page's colours and fonts.

    A hundredth of a pixel is the smallest step.
    """
    if tag == "<g/>":
        return ""
    tag = _NEEDLESS.sub("", tag.replace("xlink:href=", "href="))
    tag = _ID.sub(lambda match: f' id="{ids[match[1]]}"' if match[1] in ids else "", tag)
    tag = _REFERENCE.sub(lambda match: match[0].replace(f"#{match[1]}", f"#{ids[match[1]]}"), tag)
    tag = _FONT.sub(lambda match: f"{'font-weight: 600; ' if match[1] else ''}font-size: {match[2]}", tag)
    tag = _LAST_ZERO.sub("", _FURTHER_DIGITS.sub("", tag))
    for placeholder, variable in _VARIABLES.items():
        tag = tag.replace(placeholder, variable)
    return tag
