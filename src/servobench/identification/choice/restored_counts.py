"""A speed that is a difference of counts is converted back to counts, if a motor explains them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import NotIdentifiable
from servobench.core.finding import Finding, info
from servobench.core.rounding import TWO_SIDED
from servobench.core.units import unit
from servobench.identification.choice.noise_choice import allow_for_disturbance
from servobench.identification.estimators.base import ESTIMATORS, Fit
from servobench.identification.models.base import STRUCTURES
from servobench.identification.models.motion import turns_both_ways
from servobench.identification.trust.validation import explains_the_colour, is_rounding
from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.measurement.summation import Summation, summations

_MOST = 2000  # samples in which the counts have to prove themselves
# Of Q/√12: what accumulates, as the steps of a converter do when they are summed, may go into a random torque, and what is left
# beside it is rarely as large as the rounding of counts. That of four records of an encoder was 0.97 to 1.02 of it.
_BESIDE_TORQUE = (0.9, 1.1)
# Of Q/√12, from sample to sample: beside a torque that moves the shaft by more than its rounding, that isn't seen by itself.
_SHAKEN = 1.25
_NOISY = 11.0  # of Q/√12: three counts of noise in a reading
# The correlation of neighbouring second differences is -4/6 for white readings, and -1/2 for the sum of white speeds. Half way
# between the two, either is four standard deviations (1/√2000) off; as far on the other side is what alternates.
_ONE_BY_ONE = (-0.75, -0.583)
# Where samples are too few for that: of neighbouring first differences it is -1/2 and 0, and 0.7 and 1 over √n off by chance.
_FEW = 1300
_ANOTHER_BACK = -0.3
_WORSE = 2.0  # a central difference that is summed from sample to sample is a mean of two counts, with √2 less rounding
# Sample times: a torque moves a motor that forgets faster from sample to sample, as errors of its speeds move a sum.
_SLOW = 2.0
_NO_LAG = 0.5  # sample times: a motor as fast as that is at its end within two rows
_AHEAD = 0.25  # of a sample time: what the times of a row may be off by
_STRUCTURES = {True: ("first_order_coulomb",), False: ("first_order_one_way", "first_order_one_way_rest")}
_PRINTED = ("rad/s", "deg/s", "rpm", "rev/s")
_EXACT = 1e-4  # of a step that is a power of ten; no encoder's is as near to one by chance more than once in a thousand


def with_counts_restored(
    records: Sequence[Dataset], estimator: str = "auto"
) -> tuple[tuple[Dataset, ...], list[Finding]]:
    """Return the records with each speed that was differenced from counts summed back to a position, and findings that say so.

    A difference makes of an encoder's rounding, which is known to stay within a count, a noise that only a long record averages
    out. Summed back, nothing of what the counts say is lost. All speeds that are fitted together are summed, or none. The proof
    is a fit of a first-order motor: what it leaves of the sum, beside a random torque, has to be the rounding of those counts.
    An `estimator` given by name gets the speed as it is.
    """
    if estimator != "auto" or any(record.kind != "speed" for record in records):
        return tuple(records), []
    restored = []
    for record in records:
        incomplete = any(finding.code == "position-disagrees" for finding in record.findings)
        summation = None if incomplete else _restore(record)
        if summation is None:
            return tuple(records), []
        restored.append(summation)
    return tuple(each.data for each in restored), [_finding(each) for each in restored]


def _restore(record: Dataset) -> Summation | None:
    """The first position that a motor explains up to the rounding of its counts."""
    least = np.inf
    for summation in summations(record):
        fits: list[Fit] = []
        before = least
        for plain in _plain_fits(summation.data):
            least = min(least, plain.residual_sd)
            if plain.residual_sd > _WORSE * before:
                continue  # a motor explains what the rows sum to in another way better, and that isn't proof enough
            if _is_no_motor(plain):
                continue
            quiet = _ratio(plain) < _NOISY or summation.by_counts
            if is_rounding(plain) or (quiet and _has_independent_errors(plain)):
                return summation
            fits.append(plain)
        smooth = [plain for plain in fits if _roughness(plain) < _NOISY]
        if any(_is_rounding_beside_torque(plain) for plain in smooth):
            return summation
        if fits and not smooth:
            return None
    return None


def _is_no_motor(plain: Fit) -> bool:
    """Whether a fit of a sum has no lag, or is plainly ahead of its input.

    The one is an exact simulation's, whose own lag was taken for an average; the other the steps of a converter.
    """
    sample_time = plain.records[0].data.sample_time
    delay = plain["delay"]
    ahead = delay.value + TWO_SIDED * delay.sd < -_AHEAD * sample_time
    return plain.model["time_constant"] < _NO_LAG * sample_time or ahead


def _plain_fits(data: Dataset) -> Iterator[Fit]:
    part = _liveliest(data)
    for structure in _STRUCTURES[turns_both_ways([part])]:
        try:
            yield ESTIMATORS["output_error"].fit(STRUCTURES[structure], [part])
        except NotIdentifiable:
            continue


def _roughness(fit: Fit) -> float:
    """The size of the residual's changes from sample to sample, in Q/√12: motion that the model lacks is smoother.

    Of white noise, fourth differences have √(1 + 16 + 36 + 16 + 1) times its standard deviation.
    """
    record = fit.records[0]
    differences = np.abs(np.diff(record.residual, 4))
    sd = float(np.median(differences)) / 0.6745 / float(np.sqrt(70 / 12))
    return sd / (record.data.quantum or float("nan"))


def _is_rounding_beside_torque(plain: Fit) -> bool:
    """Whether each reading has an error of its own beside a random torque: the rounding of counts, and maybe some noise.

    A logger that keeps every n-th speed makes sums that wander. So does the shaft under a torque, but not from sample to sample.
    """
    data = plain.records[0].data
    if plain.model["time_constant"] < _SLOW * data.sample_time:
        return False
    if _is_printed((data.quantum or np.nan) / data.sample_time):
        return False
    fit = allow_for_disturbance(plain)
    if fit.disturbance is None or not explains_the_colour(fit):
        return False
    low, high = _BESIDE_TORQUE
    if _ratio(fit) < low:
        return _roughness(plain) > _SHAKEN
    return low <= _ratio(fit) <= high or (low <= _ratio(fit) < _NOISY and _has_independent_errors(fit))


def _ratio(fit: Fit) -> float:
    """The standard deviation of a fit's residual, in Q/√12."""
    return fit.residual_sd * float(np.sqrt(12)) / (fit.records[0].data.quantum or float("nan"))


def _has_independent_errors(fit: Fit) -> bool:
    """Whether the residuals of a position are independent reading errors, by second differences; of few by first ones, too."""
    residual = fit.records[0].residual
    low, high = _ONE_BY_ONE
    if not low <= _neighbours(np.diff(residual, 2)) <= high:
        return False
    return len(residual) >= _FEW or _neighbours(np.diff(residual)) <= _ANOTHER_BACK


def _neighbours(x: Array) -> float:
    """The correlation of each number with the next one, (N,)."""
    return float(x[1:] @ x[:-1] / (x @ x))


def _is_printed(step: float) -> bool:
    """Whether a step of a speed [rad/s] is the last digit of a printed number in some unit."""
    digits = [np.log10(step / unit(symbol).factor) for symbol in _PRINTED]
    return any(abs(digit - round(digit)) < _EXACT for digit in digits)


def _liveliest(data: Dataset) -> Dataset:
    """The part of a long record in which the motor goes farthest."""
    if len(data.y) <= _MOST:
        return data
    way = np.concatenate([np.zeros(1), np.cumsum(np.abs(np.diff(data.y)))])
    first = int(np.argmax(way[_MOST:] - way[:-_MOST]))
    return data.part(float(data.t_output[first]), float(data.t_output[first + _MOST]))


def _finding(summation: Summation) -> Finding:
    data = summation.data
    turn = f" ({2.0 * np.pi / (data.quantum or np.nan):.6g} in a turn)" if data.position_unit == "rad" else ""
    return info(
        "counts-restored",
        f"{data.name}: this speed is the difference of counts of {data.quantum:.6g} {data.position_unit}{turn}, "
        f"taken {summation.how}; it was summed back to the counts, which are fitted instead because they hold more "
        "information.",
    )
