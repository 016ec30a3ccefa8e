"""Is the model right? Tests on its residuals."""

from __future__ import annotations

import numpy as np

from servobench.core.arguments import check_type
from servobench.core.channels import Array
from servobench.core.finding import Finding, info, warning
from servobench.identification.estimators.base import Fit, FittedRecord
from servobench.identification.estimators.disturbance import Disturbance, innovations_of_blocks
from servobench.identification.estimators.prediction_error import rounding_explains
from servobench.identification.estimators.residual_correlation import TIED, input_correlation
from servobench.identification.models.turning import Sliding

_LAGS = 20
# The residual of a perfect model behind an ideal encoder has the standard deviation Q/√12; more than a fifth above it
# is something else than rounding.
_ROUNDING = 1.2
# Of χ² with 20 degrees of freedom, for means over blocks. What is left there of an encoder's rounding reached 170 in 420 records
# under a white torque; a torque with a memory of 0.5 s makes 260 to 2400.
_SLOW = 200.0
_MANY = 100  # blocks, five times the lags: of fewer, whiteness shows little


def validate(fit: Fit) -> tuple[Finding, ...]:
    """Return what the residuals say about a fit: their size relative to the encoder's rounding, their colour,
    and their correlation with the input.

    >>> import servobench as sb
    >>> with sb.connect("twin") as motor:
    ...     recording = sb.run(sb.Experiment(duration="3 s"), motor)
    >>> [finding.code for finding in validate(sb.identify(recording).fit)]
    ['residual-is-rounding']
    """
    check_type("fit", fit, Fit, "the fit of a Result, result.fit")
    rounding = is_rounding(fit)
    findings = [_size(fit, rounding)] if rounding is not None else []
    # Of a first-order model the intervals hold what the residual says, and experience with such models.
    first_order = {"gain", "time_constant"} <= set(fit.model.names)
    say = info if first_order else warning
    if not explains_the_colour(fit):
        allowance = (
            "The intervals allow for it, based on the residual and on experience with other motors."
            if first_order
            else "The intervals allow for the colour, but not for a bias."
        )
        findings.append(
            say(
                "residual-coloured",
                "The residual isn't white noise: something that the model leaves out acts on the "
                f"motor or on the measurement. {allowance}",
            )
        )
    tied = input_correlation(fit)
    # Rounding that repeats with the input follows it, too; but where each count is where it belongs, no response is missing.
    counted = fit.estimator == "interval_likelihood" and rounding_explains(fit)
    if tied > TIED and not counted:
        findings.append(
            say(
                "residual-follows-input",
                f"The residual is correlated with the input ({tied:.0f} standard deviations at "
                "the worst lag): part of the motor's response to the input is missing from this "
                "model.",
            )
        )
    return tuple(findings)


def explains_the_colour(fit: Fit) -> bool:
    """Return whether nothing but white noise or the encoder's rounding is left of the innovations.

    The rounding of an ideal encoder is coloured by nature, but hardly at the low frequencies that carry the parameters. Beside a
    disturbance these frequencies are examined by themselves: a torque that isn't white may hide below the rounding. Where they
    are white over many blocks, the samples need not be. Those of a rest all have one rounding error, and count for nothing.
    """
    if fit.disturbance is not None:
        blocks = [_innovations_of_blocks(fit, record, fit.disturbance) for record in fit.records]
        slow = max(map(_whiteness, blocks))
        if slow > _SLOW:
            return False
        if slow <= _CHI2_99 and min(map(len, blocks)) >= _MANY:
            return True
    if is_rounding(fit):
        return True
    return max(_whiteness(_innovations_of_samples(fit, record)) for record in fit.records) <= _CHI2_99


def is_plainly_coloured(fit: Fit) -> bool:
    """Return whether the innovations of samples are coloured by more than chance makes of a million records, and by a good part.

    A part is the sum of the squared autocorrelations over 20 lags: what is below is no more than a sandwich allows for.
    """
    for record in fit.records:
        innovations = _innovations_of_samples(fit, record)
        statistic = _whiteness(innovations)
        if statistic > _CHI2_1E6 and statistic > _GOOD_PART * len(innovations):
            return True
    return False


def _innovations_of_blocks(fit: Fit, record: FittedRecord, disturbance: Disturbance) -> Array:
    """The innovations of blocks (B,) of a record of a fit that has a disturbance."""
    return innovations_of_blocks(record.residual, record.data, _state_of_motion(fit, record), disturbance)


def _innovations_of_samples(fit: Fit, record: FittedRecord) -> Array:
    """The innovations (N,) of a record's samples, beside a disturbance those of a moving shaft only."""
    keep = record.valid
    if fit.disturbance is not None:
        keep = keep & (_state_of_motion(fit, record).left > 0)
    return record.innovations[keep]


def _state_of_motion(fit: Fit, record: FittedRecord) -> Sliding:
    return fit.model.structure.sliding(np.concatenate([fit.model.theta, record.nuisance]), record.data)


def is_rounding(fit: Fit) -> bool | None:
    """Return whether the residual is no larger than the encoder's rounding explains; None where no quantum is known."""
    quanta = {record.data.quantum for record in fit.records}
    quantum = quanta.pop() if len(quanta) == 1 else None
    if not quantum or any(record.data.chain.linear for record in fit.records):
        return None
    return bool(fit.residual_sd <= _ROUNDING * quantum / np.sqrt(12))


def _size(fit: Fit, rounding: bool) -> Finding:
    quantum = fit.records[0].data.quantum or np.nan
    ratio = fit.residual_sd / (quantum / np.sqrt(12))
    if rounding and fit.estimator == "prediction_error":
        return info(
            "measurement-is-rounding",
            "Apart from the disturbance, the measurement noise is encoder rounding only "
            f"({ratio:.2f} times a count/√12).",
        )
    if rounding:
        return info(
            "residual-is-rounding",
            f"The residual is encoder rounding only ({ratio:.2f} times a count/√12).",
        )
    return info(
        "residual-above-rounding",
        f"The residual is {ratio:.3g} times the encoder's rounding: the motor or the model is the "
        "limit, not the encoder.",
    )


# The 99 % point of χ² with 20 degrees of freedom.
_CHI2_99 = 37.566
_CHI2_1E6 = 65.42  # what a chance of one in a million exceeds
_GOOD_PART = 0.1


def _whiteness(residual: Array) -> float:
    """The statistic of Ljung and Box (1978) over 20 lags, which is χ² with 20 degrees of freedom for white noise."""
    n = len(residual)
    e = residual - residual.mean()
    power = float(e @ e)
    if n <= 2 * _LAGS or power == 0:
        return 0.0
    rho = np.array([float(e[lag:] @ e[:-lag]) for lag in range(1, _LAGS + 1)]) / power
    return float(n * (n + 2) * np.sum(rho**2 / (n - np.arange(1, _LAGS + 1))))
