"""A dataset: what identification works on."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property, wraps
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import LARGEST_VALUE, Array
from servobench.core.errors import UsageError
from servobench.core.finding import Finding
from servobench.recordings.measurement.base import Chain, Kind, Mask, StartState
from servobench.recordings.measurement.first_motion import FirstMotion, first_motion, noise_of
from servobench.recordings.recording import Source

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Dataset:
    """Identification data: an input and an output, each at its own times, in SI units.

    `u` (N,) in `input_unit` holds from `t_input[k]` to `t_input[k+1]` [s]; before the first time it was `input_before`.
    `y` (M,) in `output_unit` is what stood at the end of the measurement `chain` at `t_output[k]` [s], a position or a speed
    (`kind`). The chain is two: the `declared` stages ran before the record began, so nobody knows what state they were in at
    its start; the `applied` ones started from zero with the first sample, as they do in a prediction.
    `quantum` is the smallest step of `y` where it is known and `y` is a plain position; the error of rounding is then
    at most half of it. `delay` is what the device says of itself [s] and is not part of what is identified.
    `starts_at_rest` says that the shaft rests at the first sample, because somebody said so.
    `user_unit` is the unit of position that whoever recorded it thinks in, and how many of it are one of the output's SI unit.
    `chain_known` says that somebody said what the chain is, be it that there is nothing in between; False where nobody did.
    `hidden_delay` is the longest time [s] by which a voltage may have acted before t_input, or a sample been latched after
    t_output, on average; 0 where nothing says so.
    `reference` (N,) is what a feedback loop was told to follow, at t_input and held like u; None where the loop was open;
    `reference_unit` is its SI unit, None where nobody knows.
    `rows` (M,) are the numbers of the output's samples in its channel, from 1; None where they are 1 to M.
    `current` (M,) is the measured current of the armature [A] at t_output, NaN where it isn't known; None without one.
    Nothing is resampled; times increase but need not be regular.
    Raises `UsageError` where the values don't make a dataset.
    """

    name: str
    """The record's name."""
    t_input: Array
    u: Array
    input_unit: str
    input_before: float
    t_output: Array
    y: Array
    output_unit: str
    kind: Kind
    source: Source
    """The file or the device that it comes from."""
    quantum: float | None = None
    declared: Chain = field(default_factory=Chain)
    applied: Chain = field(default_factory=Chain)
    delay: float = 0.0
    hidden_delay: float = 0.0
    reference: Array | None = None
    reference_unit: str | None = None
    current: Array | None = None
    rows: NDArray[np.int64] | None = None
    chain_known: bool = False
    starts_at_rest: bool = False
    user_unit: tuple[str, float] | None = None
    recorded_unit: str = ""
    """The unit in which the output was recorded, such as rpm; empty where nobody knows."""
    findings: tuple[Finding, ...] = ()
    """Remarks on the data."""

    def __repr__(self) -> str:
        """The name, the units, how many samples there are, and how far apart."""
        return (
            f"<Dataset {self.name}: {self.input_unit} to {self.output_unit}, {len(self.y)} samples, {self.duration:.4g} s, "
            f"chain {str(self.chain) or 'none'}>"
        )

    def __post_init__(self) -> None:
        if not len(self.t_input) or not len(self.t_output):
            raise UsageError(
                f"{self.name}: there are no samples; expected at least one of the input and of the output"
            )
        for t, x, what in ((self.t_input, self.u, "input"), (self.t_output, self.y, "output")):
            if t.ndim != 1 or t.shape != x.shape:
                raise UsageError(
                    f"{self.name}: the {what} has values of shape {x.shape} and times of shape {t.shape}"
                )
            if not (_is_within_reach(t) and _is_within_reach(x)):
                raise UsageError(
                    f"{self.name}: the {what} has values that are not finite, or beyond {LARGEST_VALUE:g}; leave those rows out"
                )
            if (t[1:] <= t[:-1]).any():
                raise UsageError(f"{self.name}: the times of the {what} don't increase everywhere")
        r = self.reference
        if r is not None and (r.shape != self.u.shape or not np.isfinite(r).all()):
            raise UsageError(
                f"{self.name}: the reference has shape {r.shape}, the input {self.u.shape}; expected a finite value of the "
                "reference for each value of the input"
            )
        i = self.current
        if i is not None and (i.shape != self.y.shape or np.isinf(i).any()):
            raise UsageError(
                f"{self.name}: the current has shape {i.shape}, the output {self.y.shape}; expected a value in A for each value "
                "of the output, NaN where it isn't known"
            )
        if self.rows is not None and self.rows.shape != self.y.shape:
            raise UsageError(
                f"{self.name}: the rows have shape {self.rows.shape}, the output {self.y.shape}; expected a number for each "
                "value of the output, or None"
            )

    def row_numbers(self, samples: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the rows of the output's channel, from 1, that samples (K,) of y, counted from 0, were read from."""
        return samples + 1 if self.rows is None else self.rows[samples]

    def row_span(self, first: int, last: int) -> tuple[int, int]:
        """Return the rows of the output's channel, from 1, of a first and a last sample of y, counted from 0."""
        begin, end = self.row_numbers(np.array([first, last])).tolist()
        return begin, end

    def in_seconds(self, t: float) -> str:
        """Return a time t [s] as a text that tells neighbouring samples apart, be t a few seconds or the time since 1970."""
        digits = 1 - math.floor(math.log10(self.sample_time)) if self.sample_time > 0 else 3
        text = f"{t:.{max(digits, 0)}f}"
        return f"{text.rstrip('0').rstrip('.') if '.' in text else text} s"

    @cached_property
    def digest(self) -> bytes:
        """A hash of the samples of input and output, the same for the same run under another name."""
        return hashlib.sha256(self.u.tobytes() + self.y.tobytes()).digest()

    @cached_property
    def chain(self) -> Chain:
        """The whole measurement chain, the declared stages first: a prediction goes through its linear part."""
        return self.declared + self.applied

    @property
    def closed_loop(self) -> bool:
        """Whether a controller made the input, so that it knows of all that disturbed the output before."""
        return self.reference is not None and not np.array_equal(self.reference, self.u)

    @cached_property
    def shaft_kind(self) -> Kind:
        """The shaft's quantity that enters the chain: its position where the chain differentiates, otherwise the `kind` of y."""
        return self.chain.linear.takes or self.kind

    @cached_property
    def valid(self) -> Mask:
        """A mask (M,) of the samples of y that don't look back before the first one; the others carry no weight."""
        return self.chain.linear.valid(self.t_output)

    @cached_property
    def start_states(self) -> tuple[StartState, ...]:
        """The S unknown start states."""
        running, _ = self._running_and_fresh
        return running.start_states(self.shaft_kind)

    @cached_property
    def start_responses(self) -> Array:
        """The responses of y to each unknown start state, per unit of it, as columns (M, S)."""
        running, fresh = self._running_and_fresh
        return fresh(running.start_responses(self.t_output), self.t_output)

    @cached_property
    def _running_and_fresh(self) -> tuple[Chain, Chain]:
        """The linear stages with an unknown state at the first sample, and those in the same state as in a prediction.

        Where the declared chain looks back before the record, the first values that a prediction feeds to the applied stages
        are not those that the data fed to them; what that leaves behind in a filter is one more unknown state.
        """
        declared, applied = self.declared.linear, self.applied.linear
        return (declared, applied) if declared.valid(self.t_output).all() else (declared + applied, Chain())

    @property
    def position_unit(self) -> str:
        """The unit of the shaft's position: rad, m or counts."""
        return self.output_unit.removesuffix("/s")

    @property
    def gain_unit(self) -> str:
        """The unit of a gain from the input to the speed, such as rad/(s·V)."""
        return (
            f"{self.position_unit}/s"
            if self.input_unit == "1"
            else f"{self.position_unit}/(s·{self.input_unit})"
        )

    @cached_property
    def input_at_output(self) -> Array:
        """The input that held just before each sample of the output (M,), in its unit."""
        if self._at_the_same_times:
            return np.append(self.input_before, self.u[:-1])
        index = np.searchsorted(self.t_input, self.t_output, side="left") - 1
        return np.where(index >= 0, self.u[np.maximum(index, 0)], self.input_before)

    @cached_property
    def _at_the_same_times(self) -> bool:
        """Whether the input comes at the same times as the output."""
        return self.t_input is self.t_output or np.array_equal(self.t_input, self.t_output)

    @cached_property
    def duration(self) -> float:
        """The time from the first to the last sample of the output [s]; 0 for less than two samples."""
        return float(self.t_output[-1] - self.t_output[0]) if len(self.t_output) > 1 else 0.0

    @cached_property
    def sample_time(self) -> float:
        """The median time between samples of the output [s]; NaN for less than two samples."""
        return float(np.median(np.diff(self.t_output))) if len(self.t_output) > 1 else float("nan")

    @cached_property
    def input_step(self) -> float:
        """The median time between samples of the input [s]; infinite for less than two samples."""
        if self._at_the_same_times:
            return self.sample_time if len(self.t_output) > 1 else float("inf")
        return float(np.median(np.diff(self.t_input))) if len(self.t_input) > 1 else float("inf")

    @cached_property
    def noise(self) -> float:
        """The largest difference of two samples of an output at rest, in its unit."""
        return noise_of(self)

    @cached_property
    def first_motion(self) -> FirstMotion | None:
        """The record's first motion; None where the input changes at once, or the output doesn't stand until it does."""
        return first_motion(self)

    def without(self, samples: NDArray[np.int64]) -> Dataset:
        """Return the dataset without samples (K,) of the output, counted from 0; the input stays whole."""
        keep = np.setdiff1d(np.arange(len(self.y)), samples)
        return replace(
            self,
            t_output=self.t_output[keep],
            y=self.y[keep],
            current=None if self.current is None else self.current[keep],
            rows=self.row_numbers(keep),
        )

    def part(self, start: float, end: float) -> Dataset:
        """Return the samples with start <= t < end [s]; the input before them is the input that held until then.

        A part that leaves out the first sample begins with all stages in the middle of their work: they are all declared.
        Raises `UsageError` where less than two samples of the output are left.
        """
        keep_out = (self.t_output >= start) & (self.t_output < end)
        if keep_out.sum() < 2:
            raise UsageError(
                f"{self.name}: between {start:g} s and {end:g} s there are fewer than two samples"
            )
        keep_in = (self.t_input >= start) & (self.t_input < end)
        earlier = np.flatnonzero(self.t_input < start)
        before = float(self.u[earlier[-1]]) if len(earlier) else self.input_before
        t_input, u = self.t_input[keep_in], self.u[keep_in]
        if not len(u):
            t_input, u = np.array([start]), np.array([before])
        return Dataset(
            name=f"{self.name} [{start:g} s to {end:g} s]",
            t_input=t_input,
            u=u,
            input_unit=self.input_unit,
            input_before=before,
            t_output=self.t_output[keep_out],
            y=self.y[keep_out],
            output_unit=self.output_unit,
            kind=self.kind,
            source=self.source,
            quantum=self.quantum,
            declared=self.declared if keep_out[0] else self.chain,
            applied=self.applied if keep_out[0] else Chain(),
            delay=self.delay,
            hidden_delay=self.hidden_delay,
            reference_unit=self.reference_unit,
            reference=None if self.reference is None else self.reference[self.hold_indices(t_input)],
            current=None if self.current is None else self.current[keep_out],
            rows=self.row_numbers(np.flatnonzero(keep_out)),
            chain_known=self.chain_known,
            starts_at_rest=self.starts_at_rest and bool(keep_out[0]),
        )

    def hold_indices(self, t: Array) -> NDArray[np.int64]:
        """Return the indices of the input's values that held at times t (K,) [s], (K,); 0 before the first."""
        return np.maximum(np.searchsorted(self.t_input, t, side="right") - 1, 0)


def _is_within_reach(x: Array) -> bool:
    """Whether all values are finite and none is too large to reckon with."""
    return bool(x.max() <= LARGEST_VALUE and x.min() >= -LARGEST_VALUE)


def keep_with_data(function: Callable[[Dataset], T]) -> Callable[[Dataset], T]:
    """Let a function of a dataset alone be evaluated once for each: the result is kept with the dataset, which is frozen."""
    name = f"{function.__module__}.{function.__qualname__}"

    @wraps(function)
    def find(data: Dataset) -> T:
        memory = vars(data)
        if name not in memory:
            memory[name] = function(data)
        result: T = memory[name]
        return result

    return find
