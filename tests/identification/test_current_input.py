"""A motor driven by a current: the same structures, other meanings of gain and time constant, which are told."""

from __future__ import annotations

import re

import numpy as np
import pytest

from servobench.core.errors import UsageError
from servobench.identification.identify import identify
from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.recording import Source
from tests.datasets import QUANTUM, prbs

K_T, J, B, FRICTION = 0.042, 2.1e-5, 4e-5, 8e-4


def driven_by_current() -> Dataset:
    """J dω/dt = k i - b ω - T_c sgn(ω) in steps of 20 µs, ±0.14 A, behind an ideal encoder."""
    t = 0.002 * np.arange(5000)
    current = prbs(5000, 100, np.random.default_rng(5)) * (0.14 / 3.0)
    angle, w, theta, dt = np.empty(5000), 0.0, 0.0, 2e-5
    for n, i in enumerate(current):
        angle[n] = theta
        for _ in range(100):
            free = (w + dt / J * K_T * i) / (1 + dt * B / J)
            stop = dt / J * FRICTION / (1 + dt * B / J)
            new = free - min(stop, max(-stop, free))
            theta += 0.5 * dt * (w + new)
            w = new
    return Dataset(
        name="current", t_input=t, u=current, input_unit="A", input_before=0.0, t_output=t,
        y=(np.floor(angle / QUANTUM) + 0.5) * QUANTUM, output_unit="rad", kind="position", source=Source(name="current"),
        quantum=QUANTUM,
    )  # fmt: skip


def test_gain_and_time_constant_are_those_of_the_shaft_alone() -> None:
    result = identify(driven_by_current())

    assert result.fit is not None
    expected = {"gain": K_T / B, "time_constant": J / B, "coulomb_voltage": FRICTION / K_T}
    for name, value in expected.items():
        # 4.5 standard deviations, and what the steps of 20 µs leave: 2e-5 s/0.525 s = 4e-5.
        assert abs(result.fit[name].value - value) < 4.5 * result.fit[name].sd + 1e-4 * value, name
    assert result.fit["gain"].unit == "rad/(s·A)"
    assert result.fit["coulomb_voltage"].unit == "A"
    sentence = next(f.sentence for f in result.findings if f.code == "input-is-a-current")
    ratio = re.search(r"k/J = (\S+)\s±", sentence)
    assert ratio is not None
    assert float(ratio[1]) == pytest.approx(K_T / J, rel=1e-3)


def test_nothing_is_held_against_a_data_sheet_in_volts() -> None:
    with pytest.raises(UsageError, match="a data sheet is in V and rad"):
        identify(driven_by_current(), nominal="qube_servo_2")
