"""The observation from a stalled shaft: V = R i + V_b sgn(i), with ω = 0, so the resistance is the slope of voltage over
current.

It follows from V = R i + k ω + V_b sgn(i) at rest. The slope excludes the brushes and the offset of the current sensor, but
needs two voltages; from a single one R is V/i, which includes them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from servobench.core.channels import Array
from servobench.core.finding import Finding, info, warning
from servobench.identification.estimators.covariance import conservative, inverse, sandwich_from_bread
from servobench.identification.motor_parameters.observation import Observation, nothing
from servobench.recordings.measurement.dataset import Dataset

_LEAST = 10  # samples
_SETTLED = 0.02  # s: longer than the lag of any small motor's winding


def is_stalled(data: Dataset) -> bool:
    """Return whether a record is one of a shaft that stands still under a voltage: the output stays within two of its steps."""
    allowed = 2.0 * (data.quantum or 0.0)
    return bool(np.ptp(data.y) <= allowed and np.any(data.u != 0) and data.current is not None)


def stall(records: Sequence[Dataset]) -> Observation:
    """Return what records of a stalled shaft, with their currents, tell of the resistance.

    A record of a shaft that moves, in other units than V, or without a current, is left out, and a finding says so.
    """
    findings = [_omission(data) for data in records if not (is_stalled(data) and data.input_unit == "V")]
    used = [data for data in records if is_stalled(data) and data.input_unit == "V"]
    rows = [_steady_samples(data) for data in used]
    if sum(len(i) for _, i in rows) < _LEAST:
        return nothing(*findings)
    voltage, current = (np.concatenate(part) for part in zip(*rows, strict=True))
    sense = np.sign(voltage)
    columns = [voltage]
    if len(np.unique(np.abs(voltage))) > 1:
        columns.append(-sense)
    else:
        findings.append(_one_level(float(abs(voltage[0]))))
    if len(np.unique(sense)) > 1:
        columns.append(np.ones(len(voltage)))
    x = np.column_stack(columns)
    slope, sd = _slope(x, current, [len(i) for _, i in rows])
    if not slope > 2 * sd:
        return nothing(*findings, _no_current())
    # The line is i = V/R - ..., as the noise is the current's.
    return Observation(
        laws=(lambda motor: 1.0 / motor["resistance"],),
        values=np.array([slope]),
        covariance=np.array([[sd**2]]),
        sentence=f"the current of the stalled shaft ({len(current)} samples)",
        findings=tuple(findings),
    )


def _steady_samples(data: Dataset) -> tuple[Array, Array]:
    """Voltage and current of a record where the voltage has held for long enough and isn't zero."""
    changes = data.t_input[data.u != np.concatenate([[data.input_before], data.u[:-1]])]
    # A sample at the instant of a change is left out: microseconds decide which of the two voltages its current belongs to.
    # A sample at the instant of a change is left out: microseconds decide to which of the two voltages its current belongs.
    last = np.searchsorted(changes, data.t_output, side="right") - 1
    since = np.full(len(data.y), np.inf)
    since[last >= 0] = data.t_output[last >= 0] - changes[last[last >= 0]]
    at = np.searchsorted(data.t_input, data.t_output - 1e-9 * data.sample_time) - 1
    voltage = np.where(at >= 0, data.u[np.maximum(at, 0)], data.input_before)
    current = np.full(len(data.y), np.nan) if data.current is None else data.current
    use = (since >= _SETTLED) & (voltage != 0) & np.isfinite(current)
    return voltage[use], current[use]


def _slope(x: Array, y: Array, lengths: Sequence[int]) -> tuple[float, float]:
    """The first coefficient of least squares and its standard deviation, coloured noise allowed for."""
    bread = inverse(x.T @ x)
    beta = bread @ (x.T @ y)
    residual = y - x @ beta
    plain = float(residual @ residual) / max(len(y) - x.shape[1], 1) * bread
    scores = np.split(x * residual[:, None], np.cumsum(lengths)[:-1])
    return float(beta[0]), float(np.sqrt(conservative(plain, sandwich_from_bread(bread, scores))[0, 0]))


def _omission(data: Dataset) -> Finding:
    if data.current is None:
        why = "it has no measured current"
    elif data.input_unit != "V":
        why = f"its input is in {data.input_unit}, not in V"
    else:
        why = "its shaft moves, or its voltage is zero"
    return info("stall-unused", f"{data.name}: not used as a record of a stalled shaft, as {why}.")


def _one_level(voltage: float) -> Finding:
    return info(
        "stall-of-one-voltage",
        f"The shaft was stalled at {voltage:g} V only, so the resistance includes the brushes' voltage drop; a "
        "second voltage would separate the two.",
        parameters=("resistance",),
    )


def _no_current() -> Finding:
    return warning(
        "stall-unused", "The current of the stalled shaft doesn't rise with the voltage: check its sensor."
    )
