"""A result in a notebook: a table, sentences and a small picture, as self-contained HTML."""

from __future__ import annotations

import base64
from collections.abc import Iterable
from html import escape
from io import BytesIO

from servobench.core.plotting import new_figure
from servobench.identification.estimators.base import Fit
from servobench.identification.plots import plot_fit

_MOST_RECORDS = 2  # in the picture; more would push the table out of sight


def picture(fit: Fit) -> str:
    """Return measured and simulated output as an `img` element, empty where there are more records than fit."""
    if len(fit.records) > _MOST_RECORDS:
        return ""
    figure, axes = new_figure(len(fit.records))
    plot_fit(fit, axes)
    file = BytesIO()
    figure.savefig(file, format="png", dpi=80)
    data = base64.b64encode(file.getvalue()).decode()
    return f'<img alt="measured and simulated output over time" src="data:image/png;base64,{data}">'


def answer(rows: Iterable[tuple[str, str]], sentences: Iterable[str], image: str) -> str:
    """Return the HTML of names with their values, of sentences, and of an image."""
    cells = "".join(f"<tr><th>{escape(name)}</th><td>{escape(value)}</td></tr>" for name, value in rows)
    paragraphs = "".join(f"<p>{escape(each)}</p>" for each in sentences)
    return f"<table>{cells}</table>{paragraphs}{image}"
