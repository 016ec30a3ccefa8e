"""A closed loop whose reference moves the motor too little to identify it, or of which the controller was identified instead."""

from __future__ import annotations

import numpy as np

from servobench.core.finding import Finding, info, refusal, warning
from servobench.core.rounding import with_unit
from servobench.identification.estimators.base import Fit, FittedRecord
from servobench.identification.trust.doubts.base import DOUBTS, Doubt
from servobench.identification.trust.doubts.echo import alike, row_by_row

_BACKWARD = 0.02  # of a gain: as near as that to the controller's law read backward, it is that law
_AT_ONCE = 2.0  # sample times: no motor's time constant is so short in a loop that is sampled for it
_KNOWN = 0.05  # of its value: a standard deviation beyond that is worth a sentence
_EXPLAINED = 90.0  # percent of the output: then the intervals say how little is known
_MORE = "a larger or richer reference (a PRBS, steps of several sizes), add a dither, or record in open loop."


def _loop_quiet(fit: Fit) -> list[Finding]:
    """Whether gain or time constant stay vague, or the search for them doesn't settle, though a controller moved the motor."""
    if not any(record.data.closed_loop for record in fit.records):
        return []
    if all(_is_law_backward(fit, record) for record in fit.records):
        gain = with_unit(fit.model["gain"], fit.unit("gain"), 3)
        sentence = (
            f"In this closed loop the voltage follows from the output, and the gain of {gain} is the controller's law read "
            "backward, not the motor's: it explains the output at once, without a time constant. "
            f"Use {_MORE}"
        )
        return [refusal("loop-tells-little", sentence, parameters=("gain", "time_constant"))]
    names = [name for name in ("gain", "time_constant") if name in fit.model.names]
    if fit.converged and all(fit.sd(name) <= _KNOWN * abs(fit.model[name]) for name in names):
        return []
    if fit.converged and fit.fit_percent >= _EXPLAINED:
        sentence = f"This closed loop reveals little about the motor. For narrower intervals use {_MORE}"
        return [info("loop-tells-little", sentence, parameters=tuple(names))]
    sentence = (
        "In this closed loop the voltage follows from the output, and the reference changes too little or too slowly to tell "
        f"the motor from the controller. Use {_MORE}"
    )
    return [warning("loop-tells-little", sentence, parameters=tuple(names))]


def _is_law_backward(fit: Fit, record: FittedRecord) -> bool:
    """Whether a fit is y = r - u/k without a lag, u = k (r - y) being what a controller makes of speed y and one reference r."""
    data = record.data
    if data.kind != "speed" or not {"gain", "time_constant"} <= set(fit.model.names):
        return False
    if fit.model["time_constant"] > _AT_ONCE * data.sample_time:
        return False
    u, begun = row_by_row(data)
    u, y = u[begun:], data.y[begun:]
    if data.reference is None or not alike(u, y):
        return False
    reference = np.interp(data.t_output[begun:], data.t_input, data.reference)
    slope, offset = np.polyfit(y, u, 1)
    near = _BACKWARD * float(np.ptp(np.append(y, reference)))
    one_reference = (
        float(np.ptp(reference)) <= near and abs(-offset / slope - float(np.median(reference))) <= near
    )
    return bool(one_reference and abs(fit.model["gain"] * float(slope) - 1.0) < _BACKWARD)


DOUBTS.member("loop_quiet")(Doubt(codes=("loop-tells-little",), about_fit=_loop_quiet))
