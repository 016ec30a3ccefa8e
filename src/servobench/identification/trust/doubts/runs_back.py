"""A shaft that goes back without an input: something that stores energy, a spring or a weight, pulls it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from servobench.core.finding import Finding, warning
from servobench.core.rounding import with_unit
from servobench.identification.estimators.base import Fit
from servobench.identification.models.steady import stretches_of_input
from servobench.identification.trust.doubts.base import DOUBTS, Doubt
from servobench.recordings.measurement.dataset import Dataset

_FEW = 8  # samples without an input
_BACK = 0.1  # of the way that the input moved the shaft: what backlash or an elastic shaft gives back is less
_COUNTS = 5.0  # of the encoder: less may be its rounding
_STANDS = 0.02  # of that way: a shaft that moves by less stands


@dataclass(frozen=True, kw_only=True)
class _Rest:
    """A stretch without an input: the rows from `first` to before `end`, and how far the shaft went back in it."""

    first: int
    end: int
    back: float


def _about(fit: Fit) -> list[Finding]:
    if any(name.startswith("gravity") for name in fit.model.names):
        return []  # the model has what pulls
    positions = [record.data for record in fit.records if record.data.kind == "position"]
    return [finding for data in positions for finding in _of(data)]


def _of(data: Dataset) -> list[Finding]:
    """Whether the shaft goes back in one stretch without an input and stands in another: no constant voltage does that."""
    rests = _rests(data)
    way = float(np.ptp(data.y))
    stands = [each for each in rests if float(np.ptp(data.y[each.first : each.end])) <= _STANDS * way]
    least = max(_BACK * way, _COUNTS * (data.quantum or 0.0))
    back = [each for each in rests if each.back > least]
    if not (stands and back):
        return []
    most = max(back, key=lambda each: each.back)
    returned = with_unit(most.back, data.output_unit, 3)
    sentence = (
        f"{data.name}: with the input at zero the shaft goes back by {returned}, although elsewhere it stands with no input. A "
        "spring, a weight or a taut cable pulls it, which this model lacks: record the motor without it."
    )
    rows = data.row_span(most.first, most.end - 1)
    return [
        warning(
            "shaft-runs-back", sentence, parameters=("gain", "time_constant", "offset_voltage"), rows=rows
        )
    ]


def _rests(data: Dataset) -> list[_Rest]:
    """The stretches without an input, of a record that has an input elsewhere."""
    u = data.input_at_output
    if not u.any():
        return []
    stretches = np.column_stack(stretches_of_input(data)).tolist()
    still = [(first, end) for first, end in stretches if u[first] == 0.0 and end - first >= _FEW]
    return [_Rest(first=first, end=end, back=_return(data, first, end)) for first, end in still]


def _return(data: Dataset, first: int, end: int) -> float:
    """How far the shaft went back from the farthest point of a stretch, against the direction in which it ran on at first.

    It has to run on for a while: what acts with a delay may still turn it round in the first samples.
    """
    sense = np.sign(data.y[first + _FEW - 1] - data.y[first])
    way = sense * data.y[first:end]
    farthest = int(np.argmax(way))
    return float(way[farthest] - way[farthest:].min()) if farthest >= _FEW - 1 else 0.0


DOUBTS.member("runs_back")(Doubt(codes=("shaft-runs-back",), about_fit=_about))
