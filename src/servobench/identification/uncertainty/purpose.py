"""The uses of a result: to simulate, to tune a loop, to compare motors, each as far as its intervals permit."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from servobench.core.rounding import plain
from servobench.identification.uncertainty.identifiability import Combination, ParameterStatus, State

_TURNED = math.radians(5)  # by which the phase margin may change over the interval of the lag
_OF_NYQUIST = 0.2  # of half the sample rate: beyond, the loop's own ticks matter more than the motor's lag
_FINEST = 0.01  # percent: no motor is the same from one hour to the next by less
_SIMULATES = 75.0  # percent: a model that predicts less is good for no simulation


def good_for(
    answers: Mapping[str, ParameterStatus],
    combinations: Sequence[Combination],
    predicts: float,
    sample_time: float,
) -> str:
    """Return one sentence that says what the figures can be used for; empty where they are good for nothing.

    `predicts` is what the model explains of data that it wasn't fitted to [%], NaN where that isn't known; a loop that runs at
    the data's `sample_time` [s] is tuned up to a fifth of half its sample rate.
    """
    loop = _loop(answers, combinations, _OF_NYQUIST * math.pi / sample_time)
    uses = [*_simulation(answers, predicts), *loop, *_comparison(answers, combinations)]
    if not uses:
        return ""
    listed = f"{', '.join(uses[:-1])}, and {uses[-1]}" if len(uses) > 1 else uses[0]
    return f"Good enough {listed}."


def _simulation(answers: Mapping[str, ParameterStatus], predicts: float) -> list[str]:
    """Whether it simulates anything, or only what is like the record, where the gain isn't known by itself."""
    if not predicts > _SIMULATES:
        return []
    what = "to simulate" if _is_known(answers, "gain") else "to simulate motion like this record's"
    return [f"{what} (it predicts {math.floor(predicts)} % of what it wasn't fitted to)"]


def _loop(
    answers: Mapping[str, ParameterStatus], combinations: Sequence[Combination], limit: float
) -> list[str]:
    """Up to which frequency [rad/s] the interval of the lag turns the phase by little, at most a `limit`."""
    lag = next((each.estimate for each in combinations if each.name == "lag"), None)
    gain = answers.get("gain")
    if lag is None and all(_is_known(answers, name) for name in ("time_constant", "delay")):
        lag = answers["time_constant"].estimate
    if lag is None or lag.interval[1] <= 0.0 or gain is None or gain.state is not State.KNOWN:
        return []
    fastest = min(_TURNED / lag.half_width, limit)
    change = _percent(gain.estimate.half_width / abs(gain.estimate.value))
    return [
        f"to tune a position loop with a crossover of at most {plain(fastest, 2)} rad/s (over the intervals its phase margin "
        f"changes by 5° at most, its gain by {change} %)"
    ]


def _comparison(answers: Mapping[str, ParameterStatus], combinations: Sequence[Combination]) -> list[str]:
    """The difference of two motors that can be told apart: √2 times the half-width of either."""
    if _is_known(answers, "gain"):
        what, estimate = "gains", answers["gain"].estimate
    else:
        speed = next((each for each in combinations if each.name == "speed_at_level"), None)
        if speed is None:
            return []
        what, estimate = "speeds", speed.estimate
    apart = _percent(math.sqrt(2) * estimate.half_width / abs(estimate.value))
    return [f"to tell two motors apart whose {what} differ by more than {apart} %"]


def _percent(share: float) -> str:
    """A share as percent, no finer than motors stay the same."""
    return plain(max(100 * share, _FINEST), 2)


def _is_known(answers: Mapping[str, ParameterStatus], name: str) -> bool:
    return name in answers and answers[name].state is State.KNOWN
