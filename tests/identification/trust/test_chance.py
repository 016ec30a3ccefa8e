"""An input that the output doesn't follow: told from one that it does, by the order of its levels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import servobench as sb
from servobench.core.finding import Verdict
from servobench.identification.trust.doubts.chance import _about_fit, _remainder
from tests.contracts.finding_examples.base import fitted, sound
from tests.datasets import QUANTUM, prbs
from tests.rig.motor.reference import Truth, march

STEP = 1e-3  # s
RUNS = 12


def decimated(seed: int, hold: int) -> sb.Result:
    """The reference motor under levels of `hold` samples each, of which every hundredth sample was kept."""
    u = prbs(5000, hold, np.random.default_rng(seed))
    angle = march(Truth(), u, STEP)[:, 2]
    y = np.floor(angle / QUANTUM) * QUANTUM
    t = np.arange(len(u)) * STEP
    return sb.identify(t=t[::100], u=u[::100], y=y[::100], input_unit="V", output_unit="rad", chain="none")


def test_an_input_that_changes_unseen_between_samples_is_not_trusted() -> None:
    """The recorded order is among the best two of twenty by chance in a tenth of the runs: 3 or more of 12 in 11 %."""
    results = [decimated(seed, hold=7) for seed in range(RUNS)]

    trusted = [result for result in results if result.verdict is Verdict.TRUSTED]
    assert len(trusted) <= 2
    assert any("fit-by-chance" in [finding.code for finding in result.findings] for result in results)


def test_a_noisy_motor_that_follows_its_input_is_no_chance() -> None:
    random = np.random.default_rng(1)
    u = prbs(2000, 50, random)
    speed = march(Truth(), u, STEP)[:, 1]
    noisy = speed + 0.5 * np.std(speed) * random.standard_normal(len(speed))
    result = sb.identify(
        t=np.arange(2000) * STEP, u=u, y=noisy, input_unit="V", output_unit="rad/s", chain="none"
    )

    fit = fitted(result.data[0])
    assert fit.fit_percent < 90
    assert _about_fit(fit) == []


def test_a_step_whose_voltage_was_measured_with_noise_has_no_levels_to_reorder() -> None:
    random = np.random.default_rng(2)
    u = np.where(np.arange(600) < 60, 0.0, 3.0)
    speed = march(Truth(), u, STEP)[:, 1]
    noisy = speed + 0.3 * np.std(speed) * random.standard_normal(len(speed))
    measured = u + 0.01 * random.standard_normal(len(u))
    result = sb.identify(
        t=np.arange(600) * STEP, u=measured, y=noisy, input_unit="V", output_unit="rad/s", chain="none"
    )

    assert "fit-by-chance" not in [finding.code for finding in result.findings]
    assert _about_fit(fitted(result.data[0])) == []


def test_of_levels_of_one_sign_the_speeds_tell_the_order() -> None:
    """A position that only grows, in rows of 40 ms and of 1 s: any order of the levels explains most of its way."""
    steps = np.concatenate([np.full(40, 0.04), np.full(20, 1.0)])
    t = np.concatenate([[0.0], np.cumsum(steps)])
    u = np.concatenate([np.arange(40) % 20 / 20, np.arange(20) / 20, [0.0]]) * 12.0
    speed = np.maximum(0.5 * (u - 0.6), 0.0)  # settled in each row, for a motor of some milliseconds
    angle = np.concatenate([[0.0], np.cumsum(speed[:-1] * steps)])
    result = sb.identify(t=t, u=u, y=np.round(angle, 2), input_unit="V", output_unit="rad", chain="none")

    assert "fit-by-chance" not in [finding.code for finding in result.findings]


def test_an_input_that_acts_before_its_row_is_written_is_no_chance() -> None:
    """A controller's log: each row has the speed after the voltage beside it has acted for a sample of two time constants."""
    u = np.concatenate([[3.0, 3.0, -0.2, 0.2, 2.1, 1.5, 0.4, 1.1, 1.6, 1.0, 0.9, 1.2, 1.3], np.full(24, 1.1)])
    speed = march(Truth(), np.append(u, 1.1), 0.2)[1:, 1]

    result = sb.identify(
        t=0.2 * np.arange(len(u)), u=u, y=speed, input_unit="V", output_unit="rad/s", chain="none"
    )

    assert "fit-by-chance" not in [finding.code for finding in result.findings]


def test_a_motor_with_much_friction_that_is_explained_is_no_chance() -> None:
    """A slow swing of the voltage, half of which friction takes: no motor without friction explains it, in any order."""
    t = 0.015 * np.arange(110)
    random = np.random.default_rng(4)
    u = 1.2 * np.sin(2 * np.pi * 0.45 * t) + 0.15 * random.standard_normal(len(t))
    speed = march(Truth(coulomb_torque=4.5e-3), u, 0.015)[:, 1]
    noisy = speed + 0.15 * np.std(speed) * random.standard_normal(len(speed))
    result = sb.identify(t=t, u=u, y=noisy, input_unit="V", output_unit="rad/s", chain="none")

    assert result.fit is not None
    assert 50 < result.fit.fit_percent < 90
    assert "fit-by-chance" not in [finding.code for finding in result.findings]


def test_a_record_that_stands_leaves_all_of_nothing() -> None:
    """Of a run and a rest that are fitted together the rest has no variation to explain."""
    moved = fitted(sound(samples=400))
    rest = replace(
        moved.records[0], data=replace(moved.records[0].data, y=np.zeros(400)), residual=np.zeros(400)
    )

    assert _remainder(replace(moved, records=(*moved.records, rest))) == _remainder(moved) + 1.0
