"""A closed loop whose reference moves the motor too little to identify it."""

from __future__ import annotations

from servobench.core.finding import Finding, info, warning
from servobench.identification.estimators.base import Fit
from servobench.identification.trust.doubts.base import DOUBTS, Doubt

_KNOWN = 0.05  # of its value: a standard deviation beyond that is worth a sentence
_EXPLAINED = 90.0  # percent of the output: then the intervals say how little is known
_MORE = "a larger or richer reference (a PRBS, steps of several sizes), add a dither, or record in open loop."


def _loop_quiet(fit: Fit) -> list[Finding]:
    """Whether gain or time constant stay vague, or the search for them doesn't settle, though a controller moved the motor."""
    if not any(record.data.closed_loop for record in fit.records):
        return []
    names = [name for name in ("gain", "time_constant") if name in fit.model.names]
    if fit.converged and all(fit[name].sd <= _KNOWN * abs(fit[name].value) for name in names):
        return []
    if fit.converged and fit.fit_percent >= _EXPLAINED:
        sentence = f"This closed loop reveals little about the motor. For narrower intervals use {_MORE}"
        return [info("loop-tells-little", sentence, parameters=tuple(names))]
    sentence = (
        "In this closed loop the voltage follows from the output, and the reference changes too little or too slowly to tell "
        f"the motor from the controller. Use {_MORE}"
    )
    return [warning("loop-tells-little", sentence, parameters=tuple(names))]


DOUBTS.member("loop_quiet")(Doubt(codes=("loop-tells-little",), about_fit=_loop_quiet))
