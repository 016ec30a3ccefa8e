"""The study `sine_sweep`: the frequency response point by point, as it is read off sines, and what friction makes of it."""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Field

from servobench.core.channels import Array
from servobench.core.errors import NotIdentifiable, UsageError
from servobench.core.rounding import plain
from servobench.core.settings import PositiveFrequency, PositiveTime, PositiveVoltage, Voltage
from servobench.lab.expression import Fact
from servobench.lab.studies.base import STUDIES, Column, Stand, StudyResult, StudySettings, Table
from servobench.lab.truth import Truth, truth_if_known
from servobench.rig.experiment import Experiment
from servobench.systems.signals.constant import Constant
from servobench.systems.signals.sine import Sine

if TYPE_CHECKING:
    from servobench.lab.graphs import Line
    from servobench.recordings.recording import Recording
    from servobench.report.illustrations import Illustration

_HALF_POWER = 10 * math.log10(2.0)  # 3.01 dB
_STEADY = 1.0  # s of a constant voltage over which the speed is taken


@dataclass(frozen=True, kw_only=True)
class _Point:
    """The response at a frequency [Hz]: amplitude of the speed over that of the voltage [rad/(s·V)], and the phase [rad]."""

    frequency: float
    gain: float
    phase: float


@STUDIES.member("sine_sweep")
class SineSweep(StudySettings):
    """The gain by a constant voltage, then a sine for each frequency: gain, decibels and phase, and τ read off both.

    The sine offset + amplitude · sin(2πft) gets `settling` before anything is read. Amplitude and phase are those of the sine
    that fits the position best, so that no derivative adds noise and lag; the hold's half sample is taken off the phase. The
    row at 0 Hz is the steady speed at offset + amplitude, less that at the offset, over the amplitude.

    Where the sine turns the motor round, Coulomb friction takes a square wave of ±u_c in phase with the speed, whose first
    harmonic is 4 u_c/π: K (U e^(jφ) - 4 u_c/π) = (1 + jωτ) A for the speed's amplitude A, the friction's *describing function*
    (Gelb and Vander Velde 1968).
    """

    amplitude: PositiveVoltage = 3.0
    """Amplitude of the sine, and the constant voltage above the offset [V]."""
    offset: Voltage = 0.0
    """Offset of the sine; above the amplitude the motor never turns round [V]."""
    frequencies: Annotated[tuple[PositiveFrequency, ...], Field(min_length=2)] = (
        0.4,
        0.8,
        1.2,
        1.6,
        2.0,
        2.4,
        2.8,
    )
    """Frequencies, rising [Hz]."""
    settling: PositiveTime = 1.0
    """Time before a reading begins [s]."""

    def __call__(self, stand: Stand) -> StudyResult:
        """Return the table, the Bode diagram and τ from magnitude and phase.

        Where the motor is simulated, what its parameters foretell stands beside what was measured. Raises `UsageError` where the
        frequencies don't rise, `NotIdentifiable` where the gain doesn't fall by 3 dB between them.
        """
        if any(b <= a for a, b in pairwise(self.frequencies)):
            raise UsageError(
                f"the frequencies {self.frequencies} Hz don't rise; expected each above the one before"
            )
        truth = truth_if_known(stand.recording)
        gain = self._constant(stand)
        points = [_Point(frequency=0.0, gain=gain, phase=0.0)]
        points += [self._sine(stand, frequency) for frequency in self.frequencies]
        corner = _corner(points)
        facts = {
            "corner": corner,
            "tau_magnitude": 1 / corner,
            "tau_phase": math.tan(-points[1].phase) / (2 * math.pi * points[1].frequency),
        }
        if truth:
            facts |= {"true_gain": truth.gain, "true_time_constant": truth.time_constant}
        return StudyResult(
            tables=(self._table(points, truth), _readings(facts)),
            figures=(self._figure(points, truth),),
            facts={name: Fact(value=value) for name, value in facts.items()},
        )

    def _constant(self, stand: Stand) -> float:
        """Steady speed for each volt above the offset."""
        levels = (self.offset + self.amplitude, self.offset)
        high, low = (self._steady(stand, level) if level else 0.0 for level in levels)
        return (high - low) / self.amplitude

    def _steady(self, stand: Stand, voltage: float) -> float:
        made = _experiment(stand, duration=self.settling + _STEADY, signal=Constant(value=voltage))
        t, y = _position(stand.run(made))
        late = t >= self.settling
        return float((y[late][-1] - y[late][0]) / (t[late][-1] - t[late][0]))

    def _sine(self, stand: Stand, frequency: float) -> _Point:
        """One frequency: as many whole periods as last two seconds at least."""
        periods = math.ceil(2 * frequency - 1e-9) + 1
        signal = Sine(amplitude=self.amplitude, offset=self.offset, frequency=frequency)
        made = _experiment(stand, duration=self.settling + periods / frequency, signal=signal)
        t, y = _position(stand.run(made))
        late = t >= t[-1] - periods / frequency + 0.5 * made.sample_time
        omega = 2 * math.pi * frequency
        wave = _wave(t[late], y[late], omega)
        # The voltage is Im(U e^(jωt)), held for a tick: half a tick later than the sine that it was taken from.
        response = 1j * omega * wave / self.amplitude * cmath.exp(0.5j * omega * made.sample_time)
        return _Point(frequency=frequency, gain=abs(response), phase=cmath.phase(response))

    def _expected_response(self, frequency: float, truth: Truth) -> complex:
        """The response with friction's describing function, or the linear one where the motor doesn't turn round."""
        omega = 2 * math.pi * frequency
        if not self._reverses(truth):
            return truth.gain / complex(1, omega * truth.time_constant)
        lost, quadrature = 4 * truth.coulomb_voltage / math.pi, omega * truth.time_constant / truth.gain
        # |U|² = (A/K + lost)² + (quadrature A)², of which the positive A.
        a, b, c = 1 / truth.gain**2 + quadrature**2, 2 * lost / truth.gain, lost**2 - self.amplitude**2
        size = (-b + math.sqrt(b * b - 4 * a * c)) / (2 * a)
        return size / complex(size / truth.gain + lost, quadrature * size)

    def _reverses(self, truth: Truth) -> bool:
        return abs(self.offset) - self.amplitude < truth.coulomb_voltage

    def _table(self, points: Sequence[_Point], truth: Truth | None) -> Table:
        return Table(
            title=f"Sines of {plain(self.amplitude)} V around {plain(self.offset)} V",
            columns=(
                _column("frequency", "frequency", "Hz", [p.frequency for p in points]),
                _column("gain", "gain", "rad/(s·V)", [p.gain for p in points]),
                _column("decibels", "gain", "dB", [_db(p.gain) for p in points]),
                _column("phase", "phase", "°", [math.degrees(p.phase) for p in points]),
                *(self._foretold(points, truth) if truth else ()),
            ),
            note="The row at 0 Hz is the constant voltage. Decibels are 20 log₁₀ of the gain in rad/(s·V).",
        )

    def _foretold(self, points: Sequence[_Point], truth: Truth) -> tuple[Column, Column]:
        expected = [self._at(point.frequency, truth) for point in points]
        law = "with friction's describing function" if self._reverses(truth) else "of the linear motor"
        return (
            _column("expected_gain", f"gain {law}", "rad/(s·V)", [abs(e) for e in expected]),
            _column("expected_phase", "its phase", "°", [math.degrees(cmath.phase(e)) for e in expected]),
        )

    def _at(self, frequency: float, truth: Truth) -> complex:
        """The expected response at a frequency; of a constant voltage friction takes u_c, where it starts from rest."""
        if frequency:
            return self._expected_response(frequency, truth)
        lost = 0.0 if self.offset else truth.coulomb_voltage
        return complex(truth.gain * (1 - lost / self.amplitude))

    def _figure(self, points: Sequence[_Point], truth: Truth | None) -> Illustration:
        from servobench.lab.graphs import Graph, Line, figure_of

        sines = points[1:]
        f = np.array([p.frequency for p in sines])
        size, angle = self._laws(f, truth) if truth else ((), ())
        gains, phases = np.array([_db(p.gain) for p in sines]), np.degrees([p.phase for p in sines])
        caption = "Dashed: the linear motor. Points: measured." if truth else "Points: measured."
        if truth and self._reverses(truth):
            caption += " Blue: with the effect of friction at reversals."
        return figure_of(
            "sweep",
            f"Bode diagram by sines of {plain(self.amplitude)} V around {plain(self.offset)} V",
            caption,
            "; ".join(
                f"{plain(p.frequency)} Hz: {plain(_db(p.gain))} dB, {plain(math.degrees(p.phase), 3)}°"
                for p in sines
            ),
            tuple(
                Graph(
                    title=title,
                    over="frequency (Hz)",
                    lines=(*laws, Line(x=f, y=measured, mark="points", label="measured")),
                    log="x",
                )
                for title, laws, measured in (("Magnitude (dB)", size, gains), ("Phase (°)", angle, phases))
            ),
        )

    def _laws(self, f: Array, truth: Truth) -> tuple[tuple[Line, ...], tuple[Line, ...]]:
        """Lines of magnitude [dB] and phase [°]: of the linear motor and, where it turns round, with friction."""
        from servobench.lab.graphs import Line

        fine = np.geomspace(f[0], f[-1], 200)
        linear = truth.gain / (1 + 2j * math.pi * fine * truth.time_constant)
        friction = np.array([self._expected_response(float(each), truth) for each in fine])

        def lines(law: Array, linear_law: Array) -> tuple[Line, ...]:
            linear_line = Line(x=fine, y=linear_law, mark="reference", label="K/(τs + 1)")
            friction_line = Line(x=fine, y=law, mark="strong", label="with friction")
            return (linear_line, friction_line) if self._reverses(truth) else (linear_line,)

        return (
            lines(20 * np.log10(np.abs(friction)), 20 * np.log10(np.abs(linear))),
            lines(np.degrees(np.angle(friction)), np.degrees(np.angle(linear))),
        )


def _experiment(stand: Stand, *, duration: float, signal: Constant | Sine) -> Experiment:
    return stand.experiment.model_copy(update={"duration": duration, "signal": signal})


def _position(recording: Recording) -> tuple[Array, Array]:
    from servobench.recordings.measurement.measure import measure

    data = measure(recording)
    return data.t_output, data.y


def _wave(t: Array, y: Array, omega: float) -> complex:
    """The complex amplitude W of the wave Im(W e^(jωt)) that fits a position which drifts besides."""
    x = np.column_stack([np.sin(omega * t), np.cos(omega * t), np.ones(len(t)), t])
    along, across, _, _ = np.linalg.lstsq(x, y, rcond=None)[0]
    return complex(along, across)


def _corner(points: Sequence[_Point]) -> float:
    """The corner frequency, 3.01 dB down [rad/s], between two points on the line through their decibels over log f."""
    goal = _db(points[0].gain) - _HALF_POWER
    for a, b in pairwise(points[1:]):
        if _db(a.gain) >= goal > _db(b.gain):
            part = (_db(a.gain) - goal) / (_db(a.gain) - _db(b.gain))
            return float(2 * math.pi * a.frequency * (b.frequency / a.frequency) ** part)
    raise NotIdentifiable(
        "the gain doesn't fall by 3 dB between the frequencies; expected some below and some above the corner"
    )


def _readings(facts: dict[str, float]) -> Table:
    rows = [
        ("from the magnitude: 1/ω where it has fallen by 3.01 dB", facts["tau_magnitude"]),
        ("from the phase at the lowest frequency: tan(-φ)/ω", facts["tau_phase"]),
    ]
    true = facts.get("true_time_constant")
    if true:
        rows.append(("the motor's own", true))
    columns = [
        _words("from", [label for label, _ in rows]),
        _column("tau", "τ", "s", [value for _, value in rows]),
    ]
    if true:
        columns.append(_column("tau_error", "error", "%", [100 * (value / true - 1) for _, value in rows], 2))
    return Table(title="The time constant", columns=tuple(columns))


def _db(gain: float) -> float:
    return 20 * math.log10(gain)


def _column(name: str, heading: str, unit: str, values: Sequence[float], digits: int = 4) -> Column:
    return Column(name=name, heading=heading, unit=unit, values=tuple(values), digits=digits)


def _words(name: str, values: Sequence[str]) -> Column:
    return Column(name=name, heading="", values=tuple(values))
