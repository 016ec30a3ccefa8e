"""The pictures of studies: courses over time, drawn as a report draws its own."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from servobench.channels import Array
from servobench.report import figures
from servobench.report.figures import Course, Curve, Look, Panel
from servobench.report.illustrations import Illustration


def line(t: Array, y: Array, look: Look, label: str = "") -> Curve:
    """Return a curve through y (N,) at t (N,) [s], with its name in the legend."""
    return Curve(t=t, y=y, look=look, label=label)


def panel(title: str, unit: str, *curves: Curve, height: float = 130.0) -> Panel:
    """Return curves of one quantity with its unit; the height is in pixels."""
    return Panel(title=title, unit=unit, curves=curves, height=height)


def over_time(
    name: str, title: str, caption: str, description: str, courses: Sequence[Course]
) -> Illustration:
    """Return a figure of one course or several beside each other; `description` says in words what is seen."""
    return Illustration(
        name=name,
        title=title,
        caption=caption,
        description=description,
        draw=partial(figures.time_courses, tuple(courses)),
    )
