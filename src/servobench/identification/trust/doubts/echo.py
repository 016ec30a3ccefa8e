"""An input that is a copy of the output."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from servobench.core.channels import Array
from servobench.core.finding import Finding, refusal, warning
from servobench.identification.models.motion import smooth_speed
from servobench.identification.trust.doubts.base import DOUBTS, Doubt
from servobench.recordings.measurement.dataset import Dataset

_FEWEST = 20  # samples
_EQUAL = 0.02  # of the largest level, or error: how near an output comes to its reference
_SETTLED = 10  # samples at the end of a level
_STILL_GOES = 0.005  # of the largest level, within these samples: a speed that still changes passes any value
_BENT = 1e-3  # of its range: what lies nearer to a line is one, but for rounding
_START, _PARTS = 3, 10  # samples at the start of a record, and parts, the last of which is its end
_NO_REFERENCE = {"rad/s", "m/s", "%"}  # a reference is named as one, and no speed has the value of a duty
_LARGE, _SMALL = 0.5, 0.1  # of the largest input: what an error is at the start of a step, and at its end
_ALIKE = 0.9999  # correlation: not even a motor without lag follows its input so well, sample by sample


def _about(records: Sequence[Dataset]) -> list[Finding]:
    return [finding for record in records for finding in (*_of(record), *_settles_at_it(record))]


def _of(data: Dataset) -> list[Finding]:
    """Whether input and output, at the same times, are the same but for scale and offset."""
    u, begun = row_by_row(data)
    speed = smooth_speed(data)
    u, t = u[begun:], data.t_output[begun:]
    if len(u) < _FEWEST:
        return []
    for what, y in (("the output", data.y[begun:]), ("the output's speed", speed[begun:])):
        if alike(u, y) and alike(_bend(u, t), _bend(y, t)) and not _is_the_controllers(data, u, y, t):
            if _brings_it_to_rest(data, u):
                return [_proportional(data)]
            sentence = (
                f"{data.name}: the input is {what} rescaled: this column was measured at the shaft "
                "and doesn't drive the motor, or a controller computed it from the output alone. Name the voltage's column "
                "with `input=COL:UNIT`; if the file has none, the input wasn't recorded; a controller's reference is "
                "named with `reference=COL`."
            )
            return [refusal("input-is-output", sentence)]
    return []


def row_by_row(data: Dataset) -> tuple[Array, int]:
    """Return the input (M,) in the rows of the output, and the row in which it begins: what is before it has no part in a law."""
    u = np.interp(data.t_output, data.t_input, data.u)
    changed = np.flatnonzero(u != u[0])
    return u, int(changed[0]) if len(changed) else 0


def alike(u: Array, y: Array) -> bool:
    """Return whether two series (N,) are the same but for scale and offset."""
    return bool(np.ptp(u) > 0 and np.ptp(y) > 0 and abs(float(np.corrcoef(u, y)[0, 1])) > _ALIKE)


def _bend(x: Array, t: Array) -> Array:
    """The departure of x (N,) from a straight line in t (N,), zero for a line: a motor follows a ramp as a line, later."""
    rest = x - np.polyval(np.polyfit(t - t[0], x, 1), t - t[0])
    return np.asarray(np.where(np.abs(rest).max() > _BENT * np.ptp(x), rest, 0.0))


def _is_the_controllers(data: Dataset, u: Array, y: Array, t: Array) -> bool:
    """Whether the input is the error times a gain.

    While the reference stays where it is a proportional controller makes the output once more, and is zero where the output is at
    its reference. The two may count from places within one step of the encoder.
    """
    if not data.closed_loop or data.reference is None:
        return False
    slope, offset = np.polyfit(y, u, 1)
    reference = np.interp(t, data.t_input, data.reference)
    near = max(_EQUAL * float(np.abs(reference - y).max()), data.quantum or 0.0)
    return bool(np.abs(-offset / slope - reference).max() <= near)


def _brings_it_to_rest(data: Dataset, u: Array) -> bool:
    """Whether the input drives a position to where the input is nothing, and is large where it starts: so does an error.

    A column that was measured at the shaft has no reason to be zero there. A reference that the file has says more than this.
    """
    if data.kind != "position" or data.reference is not None:
        return False
    first, last = float(u[:_START].mean()), float(u[-max(1, len(u) // _PARTS) :].mean())
    largest = float(np.abs(u).max())
    goes = float(data.y[-1] - data.y[0])
    return first * goes > 0 and abs(first) > _LARGE * largest and abs(last) < _SMALL * largest


def _proportional(data: Dataset) -> Finding:
    sentence = (
        f"{data.name}: the input falls in proportion to the output and ends at zero, as a proportional controller's does "
        "after one step of its reference. Such a step shows gain and time constant only together with all else in the "
        "loop: a delay, friction, a limit of the voltage that isn't in the file. Record several steps of the reference, "
        "name its column with `reference=COL`, or drive the motor without the controller. If this column was measured at "
        "the shaft, name the voltage's."
    )
    return warning("loop-proportional", sentence, parameters=("gain", "time_constant"))


def _settles_at_it(data: Dataset) -> list[Finding]:
    """Whether a speed settles at just the value of each level of the input: as behind a controller with an integral part."""
    if data.kind != "speed" or data.input_unit in _NO_REFERENCE:
        return []
    switches = np.append(data.t_input[np.flatnonzero(np.diff(data.u)) + 1], data.t_output[-1])
    starts = np.append(data.t_output[0], switches[:-1])
    first_late = np.searchsorted(data.t_output, starts + 0.7 * (switches - starts), side="right")
    after = np.searchsorted(data.t_output, switches, side="left")
    settled = []
    for at in np.flatnonzero(after - first_late >= _SETTLED):
        late = data.y[first_late[at] : after[at]]
        first, last = (float(part.mean()) for part in np.array_split(late, 2))
        settled.append((input_held(data, float(switches[at])), 0.5 * (first + last), last - first))
    levels, speeds, changes = np.array(settled).reshape(-1, 3).T
    largest = float(np.abs(levels).max(initial=0.0))
    if len(np.unique(levels)) < 2 or np.abs(changes).max() > _STILL_GOES * largest:
        return []
    if np.abs(speeds - levels).max() > _EQUAL * largest:
        return []
    sentence = (
        f"{data.name}: at each level the speed settles at the value of the input, so the input "
        "looks like the reference of a speed controller. The model then describes the closed "
        "loop, not the motor; name the voltage's column with `input=COL:V`."
    )
    return [warning("input-settles-at-output", sentence, parameters=("gain", "time_constant"))]


def input_held(data: Dataset, end: float) -> float:
    """Return the input that held just before a time [s]."""
    return float(data.u[max(int(np.searchsorted(data.t_input, end, side="left")) - 1, 0)])


DOUBTS.member("echo")(
    Doubt(codes=("input-is-output", "input-settles-at-output", "loop-proportional"), about_data=_about)
)
