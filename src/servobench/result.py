"""A result: the answer of an identification, and the reasons to trust it or not."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

from servobench.errors import NotIdentifiable
from servobench.estimators.base import Estimate, Fit
from servobench.finding import Finding, Verdict, verdict
from servobench.json_numbers import finite
from servobench.measurement.dataset import Dataset
from servobench.models.base import Output
from servobench.propagation import Derived, derived, loop_margins
from servobench.transfer_function import TransferFunction

if TYPE_CHECKING:
    import control
    import scipy.signal

SCHEMA = "servobench.result/1"


@dataclass(frozen=True, kw_only=True)
class RecordFit:
    """How well one part that was left out is simulated; `fit_percent` as in `Fit`.

    `beyond` is its misfit (root mean square) over what the rest of the data foretell: their residual, and how well they know the
    parameters.
    """

    name: str
    """The name of the record."""
    samples: int
    """How many samples were left out."""
    fit_percent: float
    beyond: float = 1.0


@dataclass(frozen=True, kw_only=True)
class Validation:
    """A model tried on data that it wasn't fitted to: how that was done, and what came out."""

    how: str
    fit_percent: float
    """100 (1 - |y - model| / |y - mean|) over all that it wasn't fitted to [%]."""
    records: tuple[RecordFit, ...]
    """The same for each record."""


@dataclass(frozen=True, kw_only=True)
class OperatingRange:
    """Where the data were taken: the smallest and the largest input and speed."""

    input: tuple[float, float]
    speed: tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class Provenance:
    """What the result was made with and from: version, time of making (ISO 8601, UTC), SHA-256 of each file."""

    version: str
    created: str
    """Time of making, ISO 8601, UTC."""
    inputs_sha256: tuple[str, ...]
    """SHA-256 of each file."""


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """One parameter held against its nominal value: the difference in standard deviations is `z`."""

    name: str
    """The parameter."""
    nominal: float
    identified: float
    """What the data say."""
    sd: float
    """The standard deviation that `z` counts in."""
    unit: str
    """The unit of the three."""

    @property
    def z(self) -> float:
        """The difference between identified and nominal value in standard deviations."""
        return (self.identified - self.nominal) / self.sd


@dataclass(frozen=True, kw_only=True, eq=False)
class Result:
    """The answer: a fit or None where the data can't support a model, findings, validation and provenance.

    `motor_parameters` are the motor's own (resistance, torque constant, inertia ...), as far as a measured current or a stated
    value determines them; empty where nothing does.
    """

    data: tuple[Dataset, ...]
    fit: Fit | None
    findings: tuple[Finding, ...]
    validation: Validation | None
    operating_range: OperatingRange
    """Where the data were taken."""
    nominal: tuple[Comparison, ...]
    """The parameters held against a data sheet; empty where none was named."""
    provenance: Provenance
    motor_parameters: Mapping[str, Estimate] = field(default_factory=dict)

    @property
    def verdict(self) -> Verdict:
        """Refused, doubtful or trusted."""
        return verdict(self.findings)

    @property
    def transfer_function(self) -> TransferFunction | None:
        """The transfer function from the input to the speed, None where there is no fit."""
        return self.fit.model.transfer_function("speed") if self.fit else None

    @property
    def equation(self) -> str:
        """The transfer function as a line, K in place of a gain that the data don't tell; empty where there is no fit."""
        system = self.transfer_function
        if self.fit is None or system is None:
            return ""
        delay = self.fit.estimates.get("delay")
        if system.delay < 0 and delay is not None and delay.interval[1] >= 0:
            system = replace(system, delay=0.0)  # below zero by chance
        gain = self.fit.estimates.get("gain")
        if gain is None or all(map(math.isfinite, gain.interval)) or len(system.numerator) > 1:
            return f"G(s) = {system}, in {system.unit}"
        _, _, rest = str(system).partition(" / ")
        return f"G(s) = K / {rest}, K isn't known, in {system.unit}"

    @cached_property
    def derived(self) -> dict[str, Derived]:
        """Poles, bandwidth, rise time, and the margins under unit position feedback, each with its interval.

        See `propagation.derived`; empty where there is no fit.
        """
        return derived(self.fit) if self.fit else {}

    def margins(
        self, controller: TransferFunction | Any = None, around: Output = "position"
    ) -> dict[str, Derived]:
        """Return the margins of a loop around the motor, each with its interval; see `propagation.loop_margins`.

        `controller` is a `TransferFunction` or a python-control system; without one it is unit feedback. Raises
        `NotIdentifiable` where there is no fit.
        """
        return loop_margins(self._known(), controller, around)

    def to_control(
        self, output: Output = "speed", *, pade_order: int | None = None
    ) -> control.TransferFunction:
        """Return the transfer function as a `control.TransferFunction`; see `interop.to_control` for the delay.

        Raises `NotIdentifiable` where there is no fit.
        """
        from servobench.interop import to_control

        return to_control(self._known().model.transfer_function(output), pade_order=pade_order)

    def to_scipy(self, output: Output = "speed", *, pade_order: int | None = None) -> scipy.signal.lti:
        """Return the transfer function as a `scipy.signal.lti`; see `interop.to_scipy` for the delay.

        Raises `NotIdentifiable` where there is no fit.
        """
        from servobench.interop import to_scipy

        return to_scipy(self._known().model.transfer_function(output), pade_order=pade_order)

    def _known(self) -> Fit:
        if self.fit is None:
            raise NotIdentifiable(
                "this result has no model, its findings say why: identify again with other data or another structure"
            )
        return self.fit

    def __str__(self) -> str:
        """The answer in lines: each parameter with half of its 95 % interval, the verdict, and the findings."""
        from servobench.rounding import rounded_interval

        lines = []
        for name, e in self.fit.estimates.items() if self.fit else ():
            told = rounded_interval(e.value, e.interval, e.unit)
            lines.append(f"{name.replace('_', ' '):16} {told if told.low else 'not known'}")
        for name, e in self.motor_parameters.items():
            lines.append(f"{name.replace('_', ' '):16} {rounded_interval(e.value, e.interval, e.unit)}")
        if self.transfer_function is not None:
            lines.append(self.equation)
        lines.append(str(self.verdict))
        lines += [f"- {finding.severity}: {finding.sentence}" for finding in self.findings]
        return "\n".join(lines)

    __repr__ = __str__

    def to_dict(self) -> dict[str, Any]:
        """Return the result as plain data of the schema `servobench.result/1`; numbers are finite or None."""
        fit, system = self.fit, self.transfer_function
        data: dict[str, Any] = {
            "schema": SCHEMA,
            "verdict": str(self.verdict),
            "findings": [_finding(finding) for finding in self.findings],
            "structure": fit.structure if fit else None,
            "estimator": fit.estimator if fit else None,
            "parameters": {} if fit is None else {name: _estimate(e) for name, e in fit.estimates.items()},
            "covariance": None if fit is None else {
                "parameters": list(fit.model.names), "matrix": fit.covariance.tolist()
            },
            "motor_parameters": {name: _estimate(e) for name, e in self.motor_parameters.items()},
            "transfer_function": None if system is None else {
                "numerator": list(system.numerator),
                "denominator": list(system.denominator),
                "output": system.output,
                "delay": system.delay,
                "unit": system.unit,
            },
            "derived": {
                name: {"value": d.value, "interval": list(d.interval), "level": d.level, "unit": d.unit, "method": d.method}
                for name, d in self.derived.items()
            },
            "fit_percent": {
                "training": fit.fit_percent if fit else None,
                "validation": self.validation.fit_percent if self.validation else None,
            },
            "validation": {
                "how": self.validation.how if self.validation else "not validated",
                "records": [] if self.validation is None else [
                    {"name": r.name, "samples": r.samples, "fit_percent": r.fit_percent}
                    for r in self.validation.records
                ],
            },
            "operating_range": {"input": list(self.operating_range.input), "speed": list(self.operating_range.speed)},
            "nominal": [
                {"name": c.name, "nominal": c.nominal, "identified": c.identified, "sd": c.sd, "z": c.z, "unit": c.unit}
                for c in self.nominal
            ],
            "records": [_record(record) for record in self.data],
            "provenance": {
                "version": self.provenance.version,
                "created": self.provenance.created,
                "inputs_sha256": list(self.provenance.inputs_sha256),
            },
        }  # fmt: skip
        plain: dict[str, Any] = finite(data)
        return plain


def _finding(finding: Finding) -> dict[str, Any]:
    return {
        "code": finding.code,
        "severity": str(finding.severity),
        "sentence": finding.sentence,
        "parameters": list(finding.parameters),
        "rows": list(finding.rows) if finding.rows else None,
    }


def _estimate(e: Estimate) -> dict[str, Any]:
    return {"value": e.value, "sd": e.sd, "interval": list(e.interval), "level": e.level, "unit": e.unit}


def _record(data: Dataset) -> dict[str, Any]:
    import numpy as np

    steps = np.diff(data.t_output)
    p99 = float(np.percentile(steps, 99)) if len(steps) else math.nan
    return {
        "source": data.source.name,
        "name": data.name,
        "samples": len(data.y),
        "duration": data.duration,
        "sample_time": {"median": data.sample_time, "p99": p99},
    }
