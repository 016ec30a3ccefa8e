"""A frequency response: points with their bands, coherence, and the part of their scatter that isn't noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.errors import UsageError
from servobench.core.finding import Finding, info, warning
from servobench.core.parameter_names import plain_words
from servobench.core.rounding import TWO_SIDED, count_text
from servobench.identification.estimators.spectral.averages import Column, average
from servobench.identification.estimators.spectral.detection import DetectionLines, detection_lines
from servobench.identification.estimators.spectral.fitting import Points, points_near
from servobench.identification.estimators.spectral.local import Local
from servobench.identification.estimators.spectral.path import Complex
from servobench.identification.models.base import STRUCTURES
from servobench.identification.models.motion import directions
from servobench.recordings.measurement.base import Kind
from servobench.recordings.measurement.dataset import Dataset
from servobench.systems.transfer_function import TransferFunction

_BOTH_WAYS = 0.02  # of the samples


@dataclass(frozen=True, kw_only=True, eq=False)
class FrequencyResponse:
    """The response G(jω) of the motor alone at `omega` (F,) [rad/s], ascending.

    Hold, device delay and measurement chain are divided out. `response` (F,) is from the input to the shaft's `output`, in
    `unit`. `sd` (F,) is the standard deviation of its real and of its imaginary part, all told; `noise_sd` (F,) what noise
    alone makes of it, `distortion_sd` (F,) what a motor that isn't linear adds in each realisation of the input, NaN where one
    realisation is all there is. Points hardly depend on each other. `coherence` (F,) is the share of the output's power that
    the input made, leakage apart. `resolution` (F,) [rad/s] is how far a point looks along the spectrum. `left_out` is how many
    lines of the spectrum up to Nyquist's frequency, or points, the input excites too little. `detection` says what is at
    harmonics that the input leaves out, None where there are none; `findings` are those of the estimation.
    """

    omega: Array
    response: Complex
    sd: Array
    noise_sd: Array
    distortion_sd: Array
    coherence: Array
    resolution: Array
    output: Kind
    unit: str
    left_out: int
    detection: DetectionLines | None = None
    findings: tuple[Finding, ...] = ()

    @property
    def magnitude(self) -> Array:
        """|G| (F,), in the unit."""
        return np.abs(self.response)

    @property
    def phase(self) -> Array:
        """The angle of G (F,) [rad], without jumps, that of the first point between -π and π."""
        return np.unwrap(np.angle(self.response))

    @property
    def magnitude_half(self) -> Array:
        """Half of the 95 % interval of |G| (F,), in the unit."""
        return TWO_SIDED * self.sd

    @property
    def phase_half(self) -> Array:
        """Half of the 95 % interval of the phase (F,) [rad]; π where it isn't known at all."""
        relative = TWO_SIDED * self.sd / np.maximum(self.magnitude, 1e-300)
        return np.where(relative < 1.0, np.arcsin(np.minimum(relative, 1.0)), np.pi)

    def as_speed(self) -> FrequencyResponse:
        """Return the response from the input to the speed: jω times that to the position."""
        if self.output == "speed":
            return self
        position, _, driven = self.unit.partition("/")
        return replace(self, **_times(self, 1j * self.omega), output="speed", unit=f"{position}/(s·{driven})")


def frequency_response(data: Dataset | Sequence[Dataset], near: str = "first_order") -> FrequencyResponse:
    """Return the frequency response that records show, at the frequencies that their input excites.

    A sine, or exact steps from one sine to the next, gives a point for each; any other input that repeats a point for each of its
    harmonics; anything else points along the whole spectrum. Points of several records at one frequency are averaged, and their
    scatter goes into `sd`. Records have to be sampled regularly; leakage of records that don't repeat is fitted, not windowed.
    A preliminary model of the structure `near` shapes the local fits. It is no assumption on the points of an input that repeats;
    those of any other input follow what the model lacks within their `resolution` only, so that for a resonance narrower than
    that a structure with one should be named. The hold's aliases are exact for that model, and off by as much of them as the
    motor differs from it.
    Raises `UsageError` where records differ in output or units, or nothing is called `near`;
    `NotIdentifiable` where they show no response.
    """
    records = (data,) if isinstance(data, Dataset) else tuple(data)
    _check(records)
    return response_of(records, points_near(STRUCTURES[near], records))


def response_of(records: Sequence[Dataset], lines: Points) -> FrequencyResponse:
    """Return the frequency response that points of records are."""
    output, first = records[0].kind, records[0]
    columns = [_points(local, shape, output) for local, shape in zip(lines.locals, lines.shapes, strict=True)]
    points = average(columns)
    return FrequencyResponse(
        omega=points.omega,
        response=points.response,
        sd=points.sd,
        noise_sd=points.noise_sd,
        distortion_sd=points.distortion_sd,
        coherence=points.coherence,
        resolution=points.resolution,
        output=output,
        unit=f"{first.position_unit}/{'(s·' if output == 'speed' else ''}{first.input_unit}{')' if output == 'speed' else ''}",
        left_out=sum(_count_omitted(local) for local in lines.locals),
        detection=detection_lines(lines.locals),
        findings=tuple(remarks(records, lines)),
    )


def remarks(records: Sequence[Dataset], points: Points) -> list[Finding]:
    """Return what there is to know of the points: frequencies left out, and friction that a linear response can't hold."""
    findings = []
    left_out = sum(_count_omitted(local) for local in points.locals)
    if left_out:
        findings.append(
            info(
                "frequencies-left-out",
                f"The frequency response has {count_text(points.count, 'point')}; {count_text(left_out, 'other')} up to "
                "the Nyquist frequency are left out, as the input hardly excites them.",
            )
        )
    if any(_turns(record) for record in records):
        findings.append(
            warning(
                "friction-in-response",
                "The motor turned both ways, so any Coulomb friction biases gain and time constant: it makes the "
                "frequency response smaller and dependent on the amplitude. Keep the motor turning one way while "
                "you excite it, or use output_error with first_order_coulomb.",
                parameters=("gain", "time_constant"),
            )
        )
    return findings


def _check(records: Sequence[Dataset]) -> None:
    if not records:
        raise UsageError("no data for a frequency response: expected at least one dataset")
    for what in ("input_unit", "output_unit", "kind"):
        differing = sorted({str(getattr(record, what)) for record in records})
        if len(differing) > 1:
            raise UsageError(
                f"the records can't share a frequency response: their {plain_words(what)}s are "
                f"{' and '.join(differing)}"
            )


def _points(local: Local, shape: TransferFunction, output: Kind) -> Column:
    """The points of one stretch, of the motor alone: the ratio to the model times the continuous-time model."""
    blocks = local.blocks
    omega = np.concatenate([block.path.omega for block in blocks]) if blocks else np.empty(0)
    model = shape.frequency_response(omega)
    if output == "speed" and local.stretch.data.shaft_kind == "position":
        model = model * 1j * omega
    if not blocks:
        return Column.none()
    variance = np.concatenate([np.diag(block.covariance).real for block in blocks])
    sd = np.sqrt(0.5 * variance) * np.abs(model)
    return Column(
        omega=omega,
        response=np.concatenate([block.ratio for block in blocks]) * model,
        sd=sd,
        noise_sd=sd,
        distortion_sd=np.full(len(omega), np.nan),
        coherence=np.concatenate([block.coherence for block in blocks]),
        resolution=np.concatenate([np.full(len(block.ratio), block.width) for block in blocks]),
        input=np.concatenate([block.input for block in blocks]),
    )


def _count_omitted(local: Local) -> int:
    """Lines that aren't excited, and points that the input excites too little."""
    quiet = len(local.stretch.lines) - len(local.stretch.excited) if local.stretch.separate else 0
    return quiet + local.unknown


def _turns(data: Dataset) -> bool:
    sense = directions(data)
    return bool(min(np.mean(sense > 0), np.mean(sense < 0)) > _BOTH_WAYS)


def _times(response: FrequencyResponse, factor: NDArray[np.complexfloating[Any, Any]]) -> dict[str, Any]:
    """The fields of a response that a factor (F,) changes."""
    size = np.abs(factor)
    return {
        "response": response.response * factor,
        "sd": response.sd * size,
        "noise_sd": response.noise_sd * size,
        "distortion_sd": response.distortion_sd * size,
    }
