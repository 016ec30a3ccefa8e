"""A model's output: from the input alone (`simulate`), or from the input and the past output (`predict`)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Protocol, runtime_checkable

import numpy as np

from servobench.core.arguments import check_mapping, check_type, text_of_value, to_number
from servobench.core.channels import Array
from servobench.core.errors import NotIdentifiable, UsageError
from servobench.identification.estimators.base import Fit, FittedRecord
from servobench.identification.estimators.disturbance import Disturbance, innovation_sd, whiten
from servobench.identification.estimators.output_error import simulate_record
from servobench.identification.models.base import Model, Output, check_output
from servobench.recordings.cells import to_numbers
from servobench.recordings.measurement.base import Chain
from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.recording import Source


@runtime_checkable
class HasFit(Protocol):
    """Something with a fit, or None where the data couldn't support one: a `Result`."""

    @property
    def fit(self) -> Fit | None:
        """The fit."""
        ...


AT_REST: Mapping[str, float] = MappingProxyType({})
_PASSES = 5  # of the search for a start state


def simulate(
    model: Model | Fit | HasFit,
    drive: Dataset | Callable[[Array], Array] | Array,
    t: Array | None = None,
    *,
    output: Output = "speed",
    chain: Chain | str = "",
    start: Mapping[str, float] = AT_REST,
) -> Array:
    """Return a model's output for an input, with friction and offset and without noise: (M,).

    `drive` is the input: values (N,) that hold from t[k] to t[k+1], or a signal, evaluated at t [s]; both
    need `t`. Before it the input is zero. `output` (`position` or `speed`) goes through the measurement
    `chain` (such as `lowpass 50 rad/s`) and is returned at the same times. A dataset provides its own times,
    chain, output and the input before it; its measured values aren't used. Only the linear stages of a chain
    are simulated.

    The simulation starts at rest at position zero. `start` sets other values for the nuisance parameters of a
    record, by their names in the model structure (`start_position`, `start_speed`, …). To fit them to
    measured data, use `predict`. Raises `UsageError` for arguments that don't fit together, `NotIdentifiable`
    for a result without a model.

    >>> import servobench as sb
    >>> with sb.connect("twin") as motor:
    ...     recording = sb.run(sb.Experiment(duration="3 s"), motor)
    >>> t = [0.0, 0.1, 0.2, 5.0]
    >>> speed = simulate(sb.identify(recording), [3.0, 3.0, 3.0, 3.0], t)  # 23.7 rad/s for each volt, less 0.16 V of friction
    >>> round(float(speed[-1]))
    67
    """
    known = _model(model)
    if isinstance(drive, Dataset):
        if t is not None or chain or output != "speed":
            raise UsageError(
                f"{drive.name} is a dataset, which brings its own times, output and chain: leave t, output and chain out"
            )
        data = drive
    elif t is None:
        raise UsageError("an input without times can't be simulated: give t, the times of its values [s]")
    else:
        data = _input_dataset(known, drive, _values("t", t), output, chain)
    return known.simulate(data, _start(known, data, start))


def predict(fit: Fit | HasFit, data: Dataset) -> Array:
    """Return the one-step-ahead prediction of a record's output (M,): each sample from the input and the samples before it.

    The noise model is the fit's own. With a disturbance (`prediction_error`) the predictor is the Kalman
    filter for random torque and measurement noise. Without one the past of the output says nothing about the
    next sample, and the prediction is the simulation. A record of the fit keeps its start state; for other
    data the start state is fitted with the parameters fixed. NaN while the chain looks back before the
    record. Raises `NotIdentifiable` for a result without a model, `UsageError` for data behind a chain if the
    fit has a disturbance.

    >>> import servobench as sb
    >>> with sb.connect("twin") as motor:
    ...     recording = sb.run(sb.Experiment(duration="3 s"), motor)
    >>> result = sb.identify(recording)
    >>> len(predict(result, result.data[0]))
    1500
    """
    known = _fit(fit)
    check_type("data", data, Dataset, "a Dataset, which measure() makes of a recording")
    if known.disturbance is not None and data.chain.linear:
        raise UsageError(
            f"{data.name} was measured through a chain (`{data.chain}`), but the fit's noise model is that of the shaft "
            "itself: simulate the record, or fit data with the same chain"
        )
    return _prediction(known, _record(known, data))


def residuals(fit: Fit | HasFit) -> tuple[Array, ...]:
    """Return the residuals of each record of a fit: measured minus predicted output, (M,) each.

    These are the errors of `predict`; those of the simulation are `residual` of each of the fit's `records`.
    NaN while the chain looks back before the record. Raises `NotIdentifiable` for a result without a model.

    >>> import servobench as sb
    >>> with sb.connect("twin") as motor:
    ...     recording = sb.run(sb.Experiment(duration="3 s"), motor)
    >>> (rest,) = residuals(sb.identify(recording))
    >>> bool(abs(rest).max() < 2 * 3.1416 / 2048)  # rounding alone: a count at the most
    True
    """
    known = _fit(fit)
    return tuple(record.data.y - _prediction(known, record) for record in known.records)


def _input_dataset(
    model: Model, drive: Callable[[Array], Array] | Array, t: Array, output: Output, chain: Chain | str
) -> Dataset:
    """A dataset with nothing measured yet: an input, and the times and the chain of the output that it is to have."""
    check_output(output)
    check_type("chain", chain, (str, Chain), "a text such as `lowpass 50 rad/s`, or a Chain")
    stages = Chain.parse(chain) if isinstance(chain, str) else chain
    kind = stages.yields(output)
    position, u = model.data.position_unit, drive(t) if callable(drive) else drive
    return Dataset(
        name="simulation",
        t_input=t,
        u=_values("drive", u),
        input_unit=model.data.input_unit,
        input_before=0.0,
        t_output=t,
        y=np.zeros(t.shape),
        output_unit=position if kind == "position" else f"{position}/s",
        kind=kind,
        source=Source(name="simulation"),
        applied=stages,
    )


def _values(argument: str, value: object) -> Array:
    """An argument as a series of numbers (N,)."""
    values, _ = to_numbers(argument, value)
    if values is None or values.ndim != 1:
        raise UsageError(
            f"{argument} is {text_of_value(value)}; expected an array of numbers, a value for each time"
        )
    return values


def _start(model: Model, data: Dataset, start: Mapping[str, float]) -> Array:
    """The record's own parameters (Q,): zero where nothing else is said."""
    check_mapping("start", start, '{"start_speed": 10.0}')
    names = [parameter.name for parameter in model.structure.nuisance(data)]
    unknown = sorted(set(start) - set(names))
    if unknown:
        raise UsageError(
            f"a {data.kind} of this model has no {' or '.join(map(repr, unknown))} to start from; it has {', '.join(names)}"
        )
    return np.array([to_number(f"start[{name!r}]", start.get(name, 0.0)) for name in names])


def _record(fit: Fit, data: Dataset) -> FittedRecord:
    """The record as the fit has it, or simulated from the start state that suits it best under the fit's noise model."""
    for record in fit.records:
        if record.data is data:
            return record
    record = simulate_record(fit.model.structure, fit.model.theta, data)
    return record if fit.disturbance is None else _restart(fit, record, fit.disturbance)


def _restart(fit: Fit, record: FittedRecord, disturbance: Disturbance) -> FittedRecord:
    """The record from the start state that makes its innovations least, by Gauss-Newton from that of the simulation."""
    structure, data, shared = fit.model.structure, record.data, len(fit.model.theta)
    best, cost = record, np.inf
    for _ in range(_PASSES):
        theta = np.concatenate([fit.model.theta, record.nuisance])
        prediction = structure.predict(theta, data)
        sliding = structure.sliding(theta, data)
        residual = data.y - prediction.y
        columns = np.column_stack([residual, prediction.jacobian[:, shared:]])
        white = whiten(columns, data, sliding, disturbance)
        now = float(white[:, 0] @ white[:, 0])
        if not now < cost:
            break
        best = replace(record, prediction=prediction.y, residual=residual, innovations=white[:, 0])
        step = np.linalg.lstsq(white[:, 1:], white[:, 0], rcond=None)[0]
        cost, record = now, replace(best, nuisance=record.nuisance + step)
    return best


def _prediction(fit: Fit, record: FittedRecord) -> Array:
    """Measured output less innovation, where there is a noise model, and the simulation where there is none."""
    data = record.data
    if fit.disturbance is None:
        return np.where(record.valid, record.prediction, np.nan)
    theta = np.concatenate([fit.model.theta, record.nuisance])
    sd = innovation_sd(data, fit.model.structure.sliding(theta, data), fit.disturbance)
    return np.where(record.valid, data.y - sd * record.innovations, np.nan)


def _model(source: Model | Fit | HasFit) -> Model:
    return source if isinstance(source, Model) else _fit(source).model


def _fit(source: Fit | HasFit) -> Fit:
    if isinstance(source, Fit):
        return source
    check_type("the model", source, HasFit, "a Result that identify() returned, or its fit")
    if source.fit is None:
        raise NotIdentifiable(
            "this result has no model (its findings say why): identify again with other data or another structure"
        )
    return source.fit
