"""A delay that is longer than anything that drives a motor takes, and that no start from rest shows."""

from __future__ import annotations

from servobench.core.finding import Finding, warning
from servobench.core.rounding import plain, with_unit
from servobench.identification.estimators.base import Fit
from servobench.identification.estimators.delay_prior import prior_of, prior_of_delay
from servobench.identification.models.first_motion import rests_at_first
from servobench.identification.trust.doubts.base import DOUBTS, Doubt
from servobench.recordings.measurement.dataset import Dataset

_NEARLY_ALL = 95.0  # % of the output: what explains as much stands for nothing else


def _about(fit: Fit) -> list[Finding]:
    data = [record.data for record in fit.records]
    prior = prior_of_delay(fit.model.structure, data)
    if prior is None or prior_of(fit) is not None:  # a delay that was assumed says so itself
        return []
    delay = fit["delay"]
    earliest = delay.interval[0]
    if fit.fit_percent > _NEARLY_ALL:
        return []
    is_late = earliest > prior.middle and prior.is_rare(earliest)
    if not is_late or any(_begins_as_late(each, earliest) for each in data):
        return []
    rows = plain(delay.value / prior.middle, 2)
    sentence = (
        f"The delay comes out as {with_unit(delay.value, 's', 2)}, {rows} sample times, which is rare where a computer drives a "
        "motor, and no start from rest shows it. Of an input that repeats, a delay that is a period too long explains as much, "
        "and a shaft that gathers or loses speed slowly at first looks like one that waits. Record a step from rest."
    )
    return [warning("delay-rare", sentence, parameters=("delay", "time_constant"))]


def _begins_as_late(data: Dataset, delay: float) -> bool:
    """Whether the shaft of a record is seen to rest for as long as a delay [s] after the first change of its input."""
    first = data.first_motion
    return first is not None and rests_at_first(data) and first.effect - first.cause >= delay


DOUBTS.member("delay_rare")(Doubt(codes=("delay-rare",), about_fit=_about))
