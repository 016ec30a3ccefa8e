"""A model that misses much more than its measurement could: another structure moves."""

from __future__ import annotations

import numpy as np

from servobench.core.finding import Finding, warning
from servobench.identification.estimators.base import Fit, FittedRecord
from servobench.identification.trust.doubts.base import DOUBTS, Doubt
from servobench.identification.trust.doubts.lattice import lattice_step

_EXPLAINED = 80.0  # percent of the output
_GOES_ON = 0.8  # of its variance: a residual's covariance with itself a sample later
_CENTRAL = -0.25  # half way from a correlation of nothing to that of central differences
_PENDULUM = (
    "According to the file a pendulum hangs on the shaft, and this structure has no gravity, so "
    "its parameters aren't the motor's. Try `structure=first_order_coulomb_gravity` with the "
    "motor's voltage as the input, or record the motor alone."
)
_RIPPLE = 0.05  # of the speed
_ROUNDING = 3.0  # quanta: what is left over beside less may be the sensor's


def _about_fit(fit: Fit) -> list[Finding]:
    """Whether a pendulum hangs on a shaft without gravity, or much is left that neither rounding nor noise explains."""
    if _pendulum_left_out(fit):
        return [warning("structure-wrong", _PENDULUM, parameters=("gain", "time_constant"))]
    codes = {finding.code for finding in fit.findings}
    if "records-disagree" in codes:
        return []
    no_noise = "weighed-twice" in codes and not _alternates(fit)
    no_noise = no_noise or ("delay-expected" in codes and _follows_itself(fit))
    if not no_noise or fit.fit_percent >= _EXPLAINED:
        return []
    rounding = [
        float(np.std(record.residual[record.valid]))
        <= _ROUNDING * (record.data.quantum or lattice_step(record.data.y) or 0.0)
        for record in fit.records
    ]
    if any(rounding) or any(map(_is_ripple, fit.records)):
        return []
    missed = 100 - fit.fit_percent
    sentence = (
        f"A first-order motor is the wrong structure for these data: it misses {missed:.0f} % of "
        "the output, which neither the sensor's rounding nor a random torque explains. Something "
        "else moves with the shaft (a pendulum, a spring, a second motor), acts before it "
        "(hysteresis, a limit), or makes it stick and slip near rest: record the motor alone and "
        "faster, or try another structure with `structure=...`."
    )
    return [warning("structure-wrong", sentence, parameters=("gain", "time_constant"))]


def _is_ripple(record: FittedRecord) -> bool:
    """Whether what is left of a speed is small beside the speed itself, and only much of a record that hardly varies."""
    top = float(np.percentile(np.abs(record.data.y), 95))
    return record.data.kind == "speed" and float(np.std(record.residual[record.valid])) <= _RIPPLE * top


def _pendulum_left_out(fit: Fit) -> bool:
    """Whether a recording names a pendulum for which the structure has no term."""
    if any(name.startswith("gravity") for name in fit.model.names):
        return False
    return any(finding.code == "bench-pendulum" for record in fit.records for finding in record.data.findings)


def _follows_itself(fit: Fit) -> bool:
    """Whether what is left over of each record goes on from sample to sample, as the error of a model does and no noise."""
    return all(likeness(record) >= _GOES_ON for record in fit.records)


def _alternates(fit: Fit) -> bool:
    """Whether what is left over of each record alternates from sample to sample, or every other one: the sensor, and no motion.

    Of the rounding of counts whose next one and last one are subtracted, as numpy's `gradient` does, neighbours have nothing to
    do with each other, and of every other one the correlation is -1/2.
    """
    return all(
        likeness(record) < 0 or (likeness(record) < -_CENTRAL and likeness(record, 2) < _CENTRAL)
        for record in fit.records
    )


def likeness(record: FittedRecord, later: int = 1) -> float:
    """Return the correlation of what is left over of a record with itself some samples later; 1 where nothing is left."""
    left = record.residual[record.valid] - record.residual[record.valid].mean()
    power = float(left @ left)
    return float(left[later:] @ left[:-later]) / power if power else 1.0


DOUBTS.member("structure_wrong")(Doubt(codes=("structure-wrong",), about_fit=_about_fit))
