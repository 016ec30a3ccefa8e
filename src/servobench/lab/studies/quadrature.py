"""The study `quadrature`: the two channels of an incremental encoder over its angle, and the count that they make."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from servobench.core.channels import Array
from servobench.lab.graphs import Graph, Line, figure_of
from servobench.lab.required_facts import required_fact
from servobench.lab.studies.base import STUDIES, Column, Stand, StudyResult, StudySettings, Table
from servobench.report.illustrations import Illustration

_EDGES = 4  # in a line of the disc: each channel rises once and falls once
_HIGH, _LOW = "light", "dark"
_CHANGES = ("A to light", "B to light", "A to dark", "B to dark")


@STUDIES.member("quadrature")
class Quadrature(StudySettings):
    """The channels A and B of an encoder, B a quarter of a line behind A, and the counter that each of their edges moves by one.

    A sees light in the first half of each line, B from its first to its third quarter, so that, by definition,
    count = floor(4 θ lines/2π).
    """

    drawn: Annotated[int, Field(ge=1, le=8)] = 2
    """The number of the disc's lines that are drawn."""

    def __call__(self, stand: Stand) -> StudyResult:
        """Return the four states of a line as a table, and the channels over the angle."""
        pitch = _EDGES * 360 / required_fact(stand, "counts_per_rev")  # degrees
        return StudyResult(
            tables=(_table(pitch),),
            figures=(_figure(pitch, self.drawn),),
            sentences=(
                "Only one channel changes from row to row. When the shaft turns back, the rows come in reverse "
                "order: after A dark, B light come A light, B light, which a decoder counts down.",
            ),
        )


def channels(phase: Array) -> tuple[Array, Array]:
    """Return what A and B see, 1 for light, at angles (N,) in lines of the disc."""
    return (phase % 1 < 0.5).astype(float), ((phase - 0.25) % 1 < 0.5).astype(float)


def _table(pitch: float) -> Table:
    middles = (np.arange(_EDGES) + 0.5) / _EDGES
    a, b = channels(middles)
    return Table(
        title="One line of the disc, turned forwards",
        columns=(
            Column(name="count", heading="count", values=tuple(float(n) for n in range(_EDGES))),
            Column(
                name="angle",
                heading="from",
                unit="°",
                values=tuple(pitch * n / _EDGES for n in range(_EDGES)),
                digits=8,
            ),
            Column(name="a", heading="A", values=tuple(_HIGH if each else _LOW for each in a)),
            Column(name="b", heading="B", values=tuple(_HIGH if each else _LOW for each in b)),
            Column(name="edge", heading="the edge that it begins with", values=_CHANGES),
        ),
    )


def _figure(pitch: float, lines: int) -> Illustration:
    # Each edge is drawn upright, by a point right before it and one right behind it.
    edges = np.arange(_EDGES * lines + 1) / _EDGES
    phase = np.sort(np.concatenate([edges - 1e-9, edges]))[1:-1]
    a, b = channels(phase)
    angle = pitch * phase
    graphs = (
        *(
            Graph(
                title=f"Channel {name}",
                over="angle (°)",
                height=50.0,
                lines=(Line(x=angle, y=y, mark="strong"),),
                ends=(-0.2, 1.2),
            )
            for name, y in (("A", a), ("B", b))
        ),
        Graph(
            title="Counter",
            over="angle (°)",
            height=110.0,
            lines=(Line(x=angle, y=np.floor(_EDGES * phase), mark="thin"),),
        ),
    )
    return figure_of(
        "channels",
        "The two channels and the counter",
        f"{lines} {'line' if lines == 1 else 'lines'} of the disc, turned forwards. Each edge of A or B is a count.",
        "Two square waves over the angle, B a quarter of a period behind A; below, a staircase with a step at each edge.",
        graphs,
    )
