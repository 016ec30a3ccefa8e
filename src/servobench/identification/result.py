"""The result of an identification, and the reasons to trust it or not."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import NotIdentifiable, UnknownName, UsageError
from servobench.core.estimate import Estimate
from servobench.core.finding import Finding, Severity, Verdict, verdict
from servobench.core.json_numbers import finite
from servobench.core.parameter_names import parameter_in_words
from servobench.core.rounding import as_known
from servobench.identification import notebook, plots, simulation
from servobench.identification.estimators.base import Fit
from servobench.identification.models.base import Output
from servobench.identification.uncertainty.composition import BudgetLine, composition
from servobench.identification.uncertainty.identifiability import Combination, ParameterStatus, State
from servobench.identification.uncertainty.propagation import (
    Derived,
    continuous_loop_margins,
    derive,
    loop_margins,
)
from servobench.identification.uncertainty.purpose import good_for
from servobench.recordings.measurement.base import Chain
from servobench.recordings.measurement.dataset import Dataset
from servobench.systems import interop
from servobench.systems.transfer_function import TransferFunction

if TYPE_CHECKING:
    import control
    import pandas
    import scipy.signal
    from matplotlib.axes import Axes

SCHEMA = "servobench.result/2"
SCHEMAS = ("servobench.result/1", SCHEMA)
"""Those that are read; the first said nothing of states, combinations and the budget."""


@dataclass(frozen=True, kw_only=True)
class RecordFit:
    """The fit of the simulation to a part that was left out; `fit_percent` as in `Fit`.

    `beyond` is its misfit (root mean square) over what the rest of the data foretell: their residual, and how well they know the
    parameters.
    """

    name: str
    """The name of the record."""
    samples: int
    """The number of samples left out."""
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
    """The range of the data: the smallest and the largest input and speed."""

    input: tuple[float, float]
    speed: tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class Provenance:
    """The result's origin: version, time of making (ISO 8601, UTC), SHA-256 of each file."""

    version: str
    created: str
    """Time of making, ISO 8601, UTC."""
    inputs_sha256: tuple[str, ...]
    """SHA-256 of each file."""


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """One parameter compared with its nominal value: the difference in standard deviations is `z`."""

    name: str
    """The parameter."""
    nominal: float
    identified: float
    """The data's answer."""
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
    """The result of an identification: a fit, or None if the data can't support a model, with findings,
    validation and provenance.

    `motor_parameters` are the motor's own (resistance, torque constant, inertia ...), as far as a measured
    current or a known value determines them; empty if none does.

    >>> import servobench as sb
    >>> with sb.connect("twin") as motor:
    ...     recording = sb.run(sb.Experiment(duration="3 s"), motor)
    >>> result = sb.identify(recording)
    >>> str(result.verdict), result["gain"].unit
    ('trusted', 'rad/(s·V)')
    """

    data: tuple[Dataset, ...]
    fit: Fit | None
    findings: tuple[Finding, ...]
    validation: Validation | None
    operating_range: OperatingRange
    """The range of the data."""
    nominal: tuple[Comparison, ...]
    """The parameters compared with a data sheet; empty where none was named."""
    provenance: Provenance
    motor_parameters: Mapping[str, Estimate] = field(default_factory=dict)
    answers: Mapping[str, ParameterStatus] = field(default_factory=dict)
    """The data's answer for each parameter of the model: its value, a combination, a bound, or nothing."""
    combinations: tuple[Combination, ...] = ()
    """Combinations of parameters that are known although not each of the parameters is."""

    def __getitem__(self, name: str) -> Estimate:
        """Return the estimate of a parameter, of the model or of the motor, with its unit and its 95 % interval.

        Raises `NotIdentifiable` where there is no fit, `UnknownName` for a name that isn't among the parameters.
        """
        estimates = {**self._require_fit().estimates, **self.motor_parameters}
        if not isinstance(name, str) or name not in estimates:
            raise UnknownName("parameter", name, estimates)
        return estimates[name]

    def keys(self) -> tuple[str, ...]:
        """Return the names of the parameters; none where there is no fit."""
        return (*(self.fit.estimates if self.fit else ()), *self.motor_parameters)

    def __iter__(self) -> Iterator[str]:
        """Iterate over the names of the parameters."""
        return iter(self.keys())

    def __contains__(self, name: object) -> bool:
        return name in self.keys()

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
        """The transfer function as a line, to as many digits as are known, K for a gain that isn't; empty without a fit.

        A delay that may be zero, or isn't known, isn't in it, unless it is part of a lag that is known only as a whole.
        """
        if self.fit is None:
            return ""
        model, estimates = self.fit.model, self.fit.estimates
        if {"gain", "time_constant"} <= set(
            model.names
        ):  # of polynomials no coefficient can be rounded by itself
            theta = [as_known(each.value, each.half_width) for each in estimates.values()]
            model = replace(model, theta=np.array(theta))
        system, unknown = model.transfer_function("speed"), self.unknown_symbols
        if "d" in unknown:
            system = replace(system, delay=0.0)
        letters = [each for each in ("K", "τ") if each in unknown]
        if len(system.denominator) != 2 and "τ" in letters:  # there are other poles
            letters.remove("τ")
        if not letters or len(system.numerator) > 1:
            return f"G(s) = {system}, in {system.unit}"
        above, _, rest = str(system).partition(" / ")
        verb = "isn't" if len(letters) == 1 else "aren't"
        pole, dot, lag = rest.partition(" · ")
        text = f"{'K' if 'K' in letters else above} / {'(τ s + 1)' if 'τ' in letters else pole}{dot}{lag}"
        return f"G(s) = {text}, {' and '.join(letters)} {verb} known, in {system.unit}"

    @property
    def unknown_symbols(self) -> frozenset[str]:
        """Those of the letters K, τ and d in G(s) = K e^(-ds)/(τs + 1) that no number should stand for; empty without a fit.

        A gain or a time constant that isn't known by itself, and a delay that isn't known or may be zero, unless it is part of a
        lag that is known as a whole.
        """
        if self.fit is None:
            return frozenset()
        gain, states = self.fit.estimates.get("gain"), {n: each.state for n, each in self.answers.items()}
        is_open = gain is not None and not all(map(math.isfinite, gain.interval))
        unknown = {
            "K": is_open or states.get("gain") in (State.COMBINATION, State.UNKNOWN),
            "τ": states.get("time_constant", State.KNOWN) is not State.KNOWN,
            "d": not self._tells_delay(states.get("delay", State.KNOWN)),
        }
        return frozenset(letter for letter, is_unknown in unknown.items() if is_unknown)

    def _tells_delay(self, state: State) -> bool:
        """Whether the delay is known and no zero, or its sum with the time constant is known and has it in it."""
        if self.fit is None or "delay" not in self.fit.model.names:
            return True
        if state is State.COMBINATION:
            return self.fit.model["delay"] > 0
        low, high = self.fit["delay"].interval
        return state is State.KNOWN and not low <= 0 <= high

    @cached_property
    def derived(self) -> dict[str, Derived]:
        """Poles, bandwidth, rise time, and the margins under unit position feedback at the data's sample time, with intervals.

        See `uncertainty.propagation.derived`; empty where there is no fit.
        """
        return derive(self.fit) if self.fit else {}

    @cached_property
    def budget(self) -> tuple[BudgetLine, ...]:
        """The parts of each interval's width; empty where there is no fit."""
        return composition(self.fit) if self.fit else ()

    @property
    def good_for(self) -> str:
        """One sentence that says what the figures can be used for; empty where they aren't trusted or good for nothing."""
        if self.verdict is not Verdict.TRUSTED or not self.data:
            return ""
        predicts = self.validation.fit_percent if self.validation else math.nan
        return good_for(
            self.answers, self.combinations, predicts, min(each.sample_time for each in self.data)
        )

    def _state(self, name: str) -> dict[str, Any]:
        answer = self.answers.get(name)
        state = answer.state if answer else State.KNOWN
        return {"state": str(state), "combination": (answer.combination or None) if answer else None}

    def margins(
        self,
        controller: TransferFunction | Any = None,
        around: Output = "position",
        *,
        sample_time: float | None = None,
    ) -> dict[str, Derived]:
        """Return the margins of a loop around the motor as it runs, tick by tick, each with its interval.

        See `propagation.loop_margins`. `controller` is a `TransferFunction` or a python-control system; without one it is unit
        feedback. `sample_time` [s] is the time between two ticks; without one it is that of the data. Raises `NotIdentifiable`
        where there is no fit, `UsageError` for a sample time that isn't above zero.
        """
        return loop_margins(self._require_fit(), controller, around, sample_time=sample_time)

    def continuous_margins(
        self, controller: TransferFunction | Any = None, around: Output = "position"
    ) -> dict[str, Derived]:
        """Return the margins of the continuous loop C(s) G(s), without ticks: what the theory says on paper.

        See `propagation.continuous_loop_margins`; `controller` is as in `margins`. A loop that runs at ticks bears less: for that
        take `margins`. Raises `NotIdentifiable` where there is no fit.
        """
        return continuous_loop_margins(self._require_fit(), controller, around)

    def to_control(
        self, output: Output = "speed", *, pade_order: int = interop.PADE_ORDER
    ) -> control.TransferFunction:
        """Return the transfer function as a `control.TransferFunction`, its delay as a Padé approximation of order 3.

        `pade_order` is another order; `to_control_and_delay` is exact. A delay whose 95 % interval holds zero, or that is below
        zero, is left out. Raises `NotIdentifiable` where there is no fit.
        """
        return interop.to_control(self._export_model(output), pade_order=pade_order)

    def to_control_and_delay(self, output: Output = "speed") -> tuple[control.TransferFunction, float]:
        """Return the rational part as a `control.TransferFunction`, and the delay [s], 0 where `to_control` leaves it out.

        Raises `NotIdentifiable` where there is no fit.
        """
        return interop.to_control_and_delay(self._export_model(output))

    def to_scipy(self, output: Output = "speed", *, pade_order: int = interop.PADE_ORDER) -> scipy.signal.lti:
        """Return the transfer function as a `scipy.signal.lti`, with its delay as `to_control` has it.

        Raises `NotIdentifiable` where there is no fit.
        """
        return interop.to_scipy(self._export_model(output), pade_order=pade_order)

    def to_scipy_and_delay(self, output: Output = "speed") -> tuple[scipy.signal.lti, float]:
        """Return the rational part as a `scipy.signal.lti`, and the delay [s], 0 where `to_control` leaves it out.

        Raises `NotIdentifiable` where there is no fit.
        """
        return interop.to_scipy_and_delay(self._export_model(output))

    def simulate(
        self,
        t: Array,
        u: Callable[[Array], Array] | Array,
        *,
        output: Output = "speed",
        chain: Chain | str = "",
        start: Mapping[str, float] = simulation.AT_REST,
    ) -> Array:
        """Return the output (N,) for an input u (N,), or a signal, at times t (N,) [s]; see `simulation.simulate`."""
        return simulation.simulate(self, u, t, output=output, chain=chain, start=start)

    def predict(self, data: Dataset) -> Array:
        """Return each sample of a record (M,) as foretold by those before it; see `simulation.predict`."""
        return simulation.predict(self, data)

    def plot(self, axes: Axes | Sequence[Axes] | None = None, *, dark: bool = False) -> Sequence[Axes]:
        """Draw measured and simulated output of each record; see `plots.plot_fit`. Raises `NotIdentifiable` without a fit."""
        return plots.plot_fit(self._require_fit(), axes, dark=dark)

    def plot_residuals(
        self, axes: Axes | Sequence[Axes] | None = None, *, dark: bool = False
    ) -> Sequence[Axes]:
        """Draw what is left over and its autocorrelation; see `plots.plot_residuals`. Raises `NotIdentifiable` without a fit."""
        return plots.plot_residuals(self._require_fit(), axes, dark=dark)

    def plot_bode(self, axes: Axes | Sequence[Axes] | None = None, *, dark: bool = False) -> Sequence[Axes]:
        """Draw the frequency response with its bands; see `plots.plot_bode`. Raises `NotIdentifiable` without a fit."""
        return plots.plot_bode(self._require_fit(), axes, dark=dark)

    def plot_budget(self, axes: Axes | Sequence[Axes] | None = None, *, dark: bool = False) -> Sequence[Axes]:
        """Draw what each interval is made of; see `plots.plot_budget`. Raises `NotIdentifiable` without a fit."""
        self._require_fit()
        return plots.plot_budget(self.budget, self.answers, axes, dark=dark)

    def to_frame(self) -> pandas.DataFrame:
        """Return the parameters as a pandas DataFrame: a row each, with value, sd, low, high, unit and state.

        Raises `NotIdentifiable` where there is no fit, `UsageError` where pandas isn't installed.
        """
        try:
            import pandas
        except ImportError:
            raise UsageError(
                "to_frame needs pandas: python -m pip install pandas, or take to_dict()"
            ) from None
        rows = {
            name: {
                "value": e.value,
                "sd": e.sd,
                "low": e.interval[0],
                "high": e.interval[1],
                "unit": e.unit,
                "state": self._state(name)["state"],
            }
            for name, e in {**self._require_fit().estimates, **self.motor_parameters}.items()
        }
        return pandas.DataFrame.from_dict(rows, orient="index")

    def _export_model(self, output: Output) -> TransferFunction:
        fit = self._require_fit()
        delay = fit.estimates.get("delay")
        system, _ = interop.hand_over(fit.model.transfer_function(output), delay.interval if delay else None)
        return system

    def _require_fit(self) -> Fit:
        if self.fit is None:
            raise NotIdentifiable(
                "this result has no model (its findings say why): identify again with other data or another structure"
            )
        return self.fit

    def answer_rows(self) -> list[tuple[str, str]]:
        """Return the words for each parameter and combination, and its value with half of its 95 % interval or what is known."""
        from servobench.core.rounding import rounded_interval
        from servobench.identification.uncertainty.status_text import in_words

        rows = []
        for name, e in self.fit.estimates.items() if self.fit else ():
            rounded = rounded_interval(e.value, e.interval, e.unit)
            instead = in_words(self.answers.get(name)) or ("" if rounded.low else "not known")
            rows.append((parameter_in_words(name, e.unit), instead or str(rounded)))
        rows += [(each.meaning, str(each.estimate)) for each in self.combinations]
        return rows + [(parameter_in_words(name), str(e)) for name, e in self.motor_parameters.items()]

    def __str__(self) -> str:
        """The answer in lines: each parameter with half of its 95 % interval, the verdict, and the findings."""
        lines = [f"{name:16} {value}" for name, value in self.answer_rows()]
        if self.transfer_function is not None:
            lines.append(self.equation)
        lines += [self.good_for] if self.good_for else []
        lines.append(str(self.verdict))
        lines += [f"- {finding.severity}: {finding.sentence}" for finding in self.findings]
        return "\n".join(lines)

    def __repr__(self) -> str:
        """The answer in one line: the verdict and each parameter."""
        parts = [f"{name} {value}" for name, value in self.answer_rows()]
        return f"<Result {self.verdict}: {', '.join(parts) or 'no model'}>"

    def _repr_html_(self) -> str:
        """The answer for a notebook: the table of parameters, the verdict, what it is good for, and a small plot."""
        sentences = [self.equation, f"{str(self.verdict).capitalize()}. {self.good_for}".strip()]
        sentences += [each.sentence for each in self.findings if each.severity is not Severity.INFO]
        image = notebook.picture(self.fit) if self.fit else ""
        return notebook.answer(self.answer_rows(), filter(None, sentences), image)

    def to_dict(self, *, derived: bool = True) -> dict[str, Any]:
        """Return the result as plain data of the schema `servobench.result/2`; numbers are finite or None.

        Without `derived` poles and margins are left out; their intervals take several times as long as identifying.
        """
        fit, system = self.fit, self.transfer_function
        data: dict[str, Any] = {
            "schema": SCHEMA,
            "verdict": str(self.verdict),
            "findings": [_finding(finding) for finding in self.findings],
            "structure": fit.structure if fit else None,
            "estimator": fit.estimator if fit else None,
            "parameters": {} if fit is None else {
                name: _estimate(e) | self._state(name) for name, e in fit.estimates.items()
            },
            "combinations": {
                each.name: _estimate(each.estimate)
                | {"meaning": each.meaning, "parameters": list(each.parameters)}
                for each in self.combinations
            },
            "budget": [
                {
                    "source": line.source,
                    "parameters": list(line.shares),
                    "share": dict(line.shares),
                    "half_width": dict(line.half_widths),
                    "dof": line.freedom,
                    "reason": line.reason,
                }
                for line in self.budget
            ],
            "good_for": self.good_for,
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
                "unknown": [each for each in ("K", "τ", "d") if each in self.unknown_symbols],
            },
            "derived": {
                name: {"value": d.value, "interval": list(d.interval), "level": d.level, "unit": d.unit, "method": d.method}
                for name, d in (self.derived.items() if derived else ())
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
        "user_unit": None
        if data.user_unit is None
        else dict(zip(("name", "factor"), data.user_unit, strict=True)),
    }
