"""The sentences about a difference."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from servobench.core.finding import list_text
from servobench.core.parameter_names import parameter_in_words
from servobench.core.rounding import SPACE, TWO_SIDED, plain, round_value, with_unit
from servobench.identification.reconciliation.base import CAUSES, Question, Sizes
from servobench.identification.reconciliation.judgement import JudgedCause, Share, Size
from servobench.identification.reconciliation.probabilities import SOMETHING_ELSE, Hypothesis
from servobench.identification.reconciliation.reenactment import AS_RECORDED, SPOKEN

if TYPE_CHECKING:
    from servobench.identification.reconciliation.explanation import Difference

_OF_THE_MOTOR = ("series_resistance", "inertia", "torque_constant")
_OF_THE_READING = {"measurement_lag", "method", "delay"}
_LIKELY = 0.5
_ALL, _MORE = 0.995, 1.05  # of a difference: parts that are all of it, as rounded, and more than that
_NOTHING = 0.005  # of a difference: a part that is rounded to none
_MANY_TIMES = 2.0  # of a difference: beyond that, the end of an interval says only that it isn't known


def difference_sentences(differences: Sequence[Difference], question: Question) -> list[str]:
    """Return a sentence for each figure: what the data say, what the other side says, and how far apart the two are."""
    other = "the claim is" if question.origin == "claim" else "the data sheet says"
    lines = []
    for n, each in enumerate(differences):
        name = parameter_in_words(each.name)
        data = round_value(each.data, each.data_half, each.unit)
        apart = abs(float(question.difference[n])) > TWO_SIDED * float(question.sd[n])
        against = with_unit(each.other, each.unit)
        more = "equal within the intervals"
        if not apart and abs(each.other - each.data) > each.data_half:
            # The interval of the data alone doesn't hold it.
            rounding = f"the {question.origin}'s rounding leaves ±{with_unit(each.other_half, each.unit, 2)}"
            more = f"equal within the intervals: {rounding}"
        if apart and each.name != "delay":
            over = "more" if each.ratio > 1 else "less"
            more = f"{with_unit(abs(each.other - each.data), each.unit, 3)} or {plain(100 * abs(each.ratio - 1), 2)} % {over}"
        elif apart:
            more = f"{with_unit(abs(each.other - each.data), each.unit, 3)} {'more' if each.other > each.data else 'less'}"
        lines.append(f"The {name} from the data is {data}; {other} {against}, {more}.")
    return lines


def sentences(
    question: Question, causes: Sequence[JudgedCause], hypotheses: Sequence[Hypothesis], alike: Sequence[str]
) -> list[str]:
    """Return the explanation: the first cause, what it leaves, what can't be distinguished from it, and what is ruled out."""
    first = causes[0]
    other = next(each.probability for each in hypotheses if each.causes == (SOMETHING_ELSE,))
    if other > _LIKELY:
        lines = [
            "None of the causes considered here explains it well: something else is likely "
            f"({probability_text(other)})."
        ]
    else:
        lines = likeliest(question, causes, hypotheses, alike)
        if first.possible and first.name in _OF_THE_READING and question.origin == "claim":
            lines += _if_the_motor(causes)
    ruled_out = [each for each in causes if not each.possible]
    if ruled_out:
        lines.append(f"It isn't {list_text([f'{each.label} ({each.against})' for each in ruled_out], 'or')}.")
    return lines  # fmt: skip


_OPEN = ("above ", "below ")  # an end that is beyond what was examined


def size_range_text(size: Size) -> str:
    """Return a size with the ends of its interval, the unit that both have written once."""
    if not size.low or size.low == size.high:
        return size.text
    if size.low.startswith(_OPEN) or size.high.startswith(_OPEN):
        return f"{size.text} ({size.low} to {size.high})"
    low, high = (end.replace(SPACE, " ").split(" ", 1) for end in (size.low, size.high))
    first = low[0] if low[1:] == high[1:] else " ".join(low)
    return f"{size.text} ({first} to {' '.join(high)})"


def likeliest(
    question: Question, causes: Sequence[JudgedCause], hypotheses: Sequence[Hypothesis], alike: Sequence[str]
) -> list[str]:
    """Return what the first cause explains and leaves, and what can't be distinguished from it; nothing if none is possible."""
    first = causes[0]
    if not first.possible:
        return []
    return [_first(question, first), *_rest(question, first, hypotheses), *_alike(first, alike)]


def _first(question: Question, first: JudgedCause) -> str:
    """The most probable cause, and how much it explains."""
    lag = first.name == "measurement_lag" and question.origin == "claim"
    if lag and question.known_lag is not None:
        method = question.method or "step_63"
        reading = next(each for each in question.readings if each.method == method)
        how = "off simulated steps of such a motor" if reading.simulated else "off these data"
        behind = reading.chain if reading.chain == AS_RECORDED else f"behind `{reading.chain}`"
        read = f"{SPOKEN[method]}, read {how} {behind}, gives {with_unit(reading.time_constant, 's')}"
        probable = probability_text(first.probability)
        return (
            f"The most likely cause is the lag of the measurement ({probable}): {read}, so the lag explains "
            f"{_shares(first.explains)}."
        )
    needed = ""
    if first.needed is not None and not first.against:
        needed = f" The whole difference would need {size_range_text(first.needed)}."
    likely = ""
    if first.likely is not None and any(map(_has_finite_interval, first.explains)):
        likely = f" At a usual size, {first.likely.text}, it explains {_shares(first.explains)}."
    return (
        f"The most likely cause is {first.label} ({probability_text(first.probability)}). "
        f"{first.law}{needed}{likely}"
    )


def _rest(question: Question, first: JudgedCause, hypotheses: Sequence[Hypothesis]) -> list[str]:
    """The sentences on what a cause of known size leaves, and whether chance is enough for that."""
    sizes = CAUSES[first.name].sizes(question)
    if not isinstance(sizes, Sizes) or len(sizes.values) != 1 or first.likely is None:
        return []
    effect = CAUSES[first.name].effect(question, first.likely.value)
    lines = []
    for n, name in enumerate(question.names):
        if name == "delay":
            continue
        left = float(question.difference[n] - effect[n])
        rest = question.after[name] * (1 - math.exp(-left))
        scatter = float(np.max(sizes.scatter.get(name, 0.0)))
        amount = with_unit(abs(rest), question.fit[name].unit, 2)
        sd = math.hypot(float(question.sd[n]), scatter)
        if abs(left) <= TWO_SIDED * sd:
            eye = " and a reading by eye" if scatter else ""
            lines.append(f"The remaining {amount} are within the claim's rounding{eye}.")
        else:
            besides = _besides(first, hypotheses)
            lines.append(
                f"The remaining {amount} of the {parameter_in_words(name)} need another cause{besides}."
            )
    return lines


def _besides(first: JudgedCause, hypotheses: Sequence[Hypothesis]) -> str:
    """The cause that most probably goes with the first one."""
    pairs = [each.causes for each in hypotheses if first.name in each.causes and len(each.causes) == 2]
    others = [name for name in pairs[0] if name != first.name] if pairs else []
    return f", most probably {CAUSES[others[0]].label}" if others else ""


def _alike(first: JudgedCause, alike: Sequence[str]) -> list[str]:
    if not alike:
        return []
    others = list_text([CAUSES[name].label for name in alike], "or")
    return [
        f"These figures can't distinguish {first.label} from {others}: each explains the difference about equally well."
    ]


def _if_the_motor(causes: Sequence[JudgedCause]) -> list[str]:
    """The sentences on what the motor itself would have to be like."""
    sizes = [
        each.needed.text
        for each in causes
        if each.name in _OF_THE_MOTOR and each.needed is not None and not each.against
    ]
    return (
        [f"To be the motor's own, the claimed figure would need {list_text(sizes, 'or')}."] if sizes else []
    )


def _has_finite_interval(share: Share) -> bool:
    """Whether a value certainly differs, so that shares of the difference make sense."""
    return all(map(math.isfinite, (share.value, *share.interval)))


def _shares(shares: Sequence[Share]) -> str:
    """`76 % (65 to 91 %) of the difference in the time constant`, for each figure that it may explain a part of."""
    lines = []
    for share in shares:
        if not _has_finite_interval(share) or share.name == "delay" or abs(share.value) < 0.005:
            continue
        part = share_text(share)
        if part == _percent(share.value):
            low, high = (100 * end for end in share.interval)
            part += f" ({low:.0f} to {high:.0f} %)"
        lines.append(f"{part} of the difference in the {parameter_in_words(share.name)}")
    return " and ".join(lines) or "no clear part of the difference"


def share_text(share: Share) -> str:
    """Return the part of a difference in a few words: `76 %`, or what is known of one that may be many times the difference."""
    low, high = share.interval
    if not _has_finite_interval(share):
        return _percent(share.value) if abs(share.value) <= _MANY_TIMES else "an unknown part"
    if low >= _ALL:
        return "more than all" if low > _MORE else "all"
    if max(-low, high) <= _MANY_TIMES:
        return _percent(share.value)
    if low > 0:
        return f"at least {_percent(low)}"
    return "none" if high <= 0 else "an unknown part"


def _percent(part: float) -> str:
    return f"{100 * part:.0f} %" if abs(part) >= _NOTHING else "0 %"


def probability_text(probability: float) -> str:
    """Return a probability in per cent, without more certainty than there is."""
    if probability > 0.995:
        return "above 99 %"
    return "below 1 %" if probability < 0.01 else f"{100 * probability:.0f} %"
