"""The courses of runs: of an exercise's own, with the reference where there is one, and of a study's, from rest at angle 0."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from servobench.core.errors import MissingInformation, NotIdentifiable
from servobench.core.rounding import with_unit
from servobench.lab.graphs import curve, panel
from servobench.lab.motion import motion_of, speed_of
from servobench.recordings.measurement.base import Chain
from servobench.recordings.measurement.measure import measure
from servobench.report import figures
from servobench.report.decimation import hold_line
from servobench.report.figures import Course, Curve, Panel
from servobench.report.illustrations import Illustration

if TYPE_CHECKING:
    from servobench.recordings.measurement.dataset import Dataset
    from servobench.recordings.recording import Recording

NAME = "course"


def course_of(recording: Recording, chain: str) -> Illustration | None:
    """Return what happened over time, looked at through a chain; None for a recording with too few samples to draw."""
    try:
        position = measure(recording)
        shown = measure(recording, chain) if Chain.parse(chain) else position
    except (NotIdentifiable, MissingInformation):
        return (
            None  # a recording with less than two samples, or without roles; the blanks that need it say so
        )
    panels = [_voltage(position)]
    if shown.kind == "speed":
        panels.append(_output("Speed", shown))
    if position.kind == "position":
        panels.append(_output("Position", position))
    behind = f" The speed is the output of the chain ‘{shown.chain}’." if shown.kind == "speed" else ""
    name = "" if recording.info is None else f" on the device ‘{recording.info.name}’"
    return Illustration(
        name=NAME,
        title="The run of this exercise",
        caption=f"Recorded{name}.{behind}",
        description=_in_words(position, shown),
        draw=partial(figures.time_courses, (Course(panels=tuple(panels)),)),
    )


def from_rest(recording: Recording, title: str) -> Course:
    """Return voltage, speed behind a filter at 50 rad/s, and the angle since the start, under a title."""
    motion = motion_of(recording)
    t, speed = speed_of(recording, "derivative | lowpass 50 rad/s")
    return Course(
        title=title,
        panels=(
            panel("Voltage", "V", curve(motion.t, motion.voltage, "input"), height=90.0),
            panel("Speed", "rad/s", curve(t, speed, "measured")),
            panel("Angle", "rad", curve(motion.t, motion.angle, "model")),
        ),
    )


def _voltage(data: Dataset) -> Panel:
    start = data.t_output[0]
    t, u = hold_line(data.t_input - start, data.u, data.input_before, data.duration)
    return Panel(title="Voltage", unit=data.input_unit, curves=(Curve(t=t, y=u, look="input"),), height=90.0)


def _output(title: str, data: Dataset) -> Panel:
    start = data.t_output[0]
    followed = data.closed_loop and data.reference_unit == data.output_unit and data.reference is not None
    measured = Curve(t=data.t_output - start, y=data.y, look="measured", label="measured" if followed else "")
    curves: tuple[Curve, ...] = (measured,)
    if followed and data.reference is not None:
        t, r = hold_line(data.t_input - start, data.reference, float(data.reference[0]), data.duration)
        curves = (measured, Curve(t=t, y=r, look="model", label="reference"))
    return Panel(title=title, unit=data.output_unit, curves=curves)


def _in_words(position: Dataset, shown: Dataset) -> str:
    texts = [
        f"the {what} is between {with_unit(float(y.min()), unit, 3)} and {with_unit(float(y.max()), unit, 3)}"
        for what, y, unit in (
            ("voltage", position.u, position.input_unit),
            *((data.kind, data.y, data.output_unit) for data in dict.fromkeys((shown, position))),
        )
    ]
    return f"Over {with_unit(position.duration, 's', 3)} {', '.join(texts)}."
