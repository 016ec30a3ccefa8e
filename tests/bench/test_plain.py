"""The plain least-squares fit that identification is held against finds the motor that made the data."""

import numpy as np
import pytest
from real_parts.plain import Plain, fitted, residuals, share

from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.recording import Source

TRUE = Plain(gain=20.0, time_constant=0.1, coulomb=0.5, delay=0.03)
STEP = 0.01


def recorded(kind: str, seed: int = 1) -> Dataset:
    """A motor with Coulomb friction and a delay of three samples by explicit Euler steps of 10 µs: no formula in common."""
    u = np.repeat(np.random.default_rng(seed).uniform(-5, 5, 30), 20)
    fine = round(STEP / 1e-5)
    speed = position = 0.0
    y = np.zeros(len(u))
    for k in range(1, len(u)):
        applied = u[k - 4] if k >= 4 else 0.0
        for _ in range(fine):
            brake = np.sign(speed) * TRUE.coulomb if speed else np.clip(applied, -TRUE.coulomb, TRUE.coulomb)
            speed += 1e-5 / TRUE.time_constant * (TRUE.gain * (applied - brake) - speed)
            position += 1e-5 * speed
        y[k] = speed if kind == "speed" else position
    t = STEP * np.arange(len(u))
    return Dataset(
        name=kind,
        t_input=t,
        u=u,
        input_unit="V",
        input_before=0.0,
        t_output=t,
        y=y,
        output_unit="rad/s" if kind == "speed" else "rad",
        kind=kind,  # type: ignore[arg-type]
        source=Source(name=kind),
    )


@pytest.mark.parametrize("kind", ["speed", "position"])
def test_the_plain_fit_finds_the_motor_and_predicts_another_record(kind: str) -> None:
    found = fitted([recorded(kind)])

    # Euler's step is 1e-4 of the time constant, and the sign of the friction chatters within 10 µs of a reversal.
    assert found.gain == pytest.approx(TRUE.gain, rel=2e-3)
    assert found.time_constant == pytest.approx(TRUE.time_constant, rel=5e-3)
    assert found.coulomb == pytest.approx(TRUE.coulomb, abs=5e-3)
    assert found.delay == pytest.approx(TRUE.delay)
    assert share(residuals(found, [recorded(kind, seed=2)])) > 99.5
