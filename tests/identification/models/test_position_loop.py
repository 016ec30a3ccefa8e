"""A servo in its own position loop: the response against a finely stepped one, and what fits find."""

from __future__ import annotations

from dataclasses import replace
from itertools import accumulate

import numba
import numpy as np
import pytest
from numpy.typing import NDArray

from servobench.core.errors import NotIdentifiable
from servobench.core.finding import Verdict
from servobench.identification.identify import identify
from servobench.identification.models.base import STRUCTURES
from servobench.identification.models.position_loop import kernels
from servobench.identification.models.position_loop.goal import goal_finding
from servobench.recordings.measurement.base import Chain
from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.recording import Source
from tests.datasets import dataset

N, STEP = 800, 0.005
QUANTUM = 2 * np.pi / 4096
ALL = np.arange(kernels.COLUMNS)
RINGING = np.array([15.0, 0.1, 0.02, 0.05, 0.0, 0.3, 2.0])
CREEPING = np.array([15.0, 0.01, 0.02, 0.05, 0.0, 0.3, 2.0])


@numba.njit(cache=True)  # type: ignore[untyped-decorator]
def _march(goal, sample_time, p, substeps, out):  # type: ignore[no-untyped-def]
    loop, tau, offset, dead, theta, w = p
    dt = sample_time / substeps
    for n in range(len(goal)):
        out[n] = theta
        for _ in range(substeps):
            # An implicit step of drag and friction: friction takes what it can, at most all of the speed.
            free = (w + dt / tau * loop * (goal[n] - offset - theta)) / (1.0 + dt / tau)
            stop = dt / tau * loop * dead / (1.0 + dt / tau)
            w_new = free - min(stop, max(-stop, free))
            theta += 0.5 * dt * (w + w_new)
            w = w_new


def march(goal: NDArray[np.float64], p: NDArray[np.float64], substeps: int) -> NDArray[np.float64]:
    out = np.empty(len(goal))
    _march(goal, STEP, (p[0], p[1], p[2], p[3], p[5], p[6]), substeps, out)
    return out


def goals(samples: int = N, hold: int = 40, seed: int = 3) -> NDArray[np.float64]:
    random = np.random.default_rng(seed)
    goal = np.repeat(random.uniform(-1, 1, samples // hold), hold)
    goal[200:300] = 0.05
    goal[500:600] = np.linspace(-1, 1, 100)
    return goal


def response(
    p: NDArray[np.float64], friction: bool, speed: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    t, goal = STEP * np.arange(N), goals()
    y, jacobian = np.empty(N), np.empty((N, kernels.COLUMNS))
    kernels.response(t, goal, goal[0], t, p, float(friction), float(speed), ALL, y, jacobian)
    return y, jacobian


def servo(seed: int = 3, loop: float = 15.0, tau: float = 0.08, dead: float = 0.03) -> Dataset:
    """10 s of steps of the goal, seen by an encoder with 4096 counts in a turn."""
    goal = goals(2000, hold=100, seed=seed)
    t = STEP * np.arange(len(goal))
    angle = march(goal, np.array([loop, tau, 0.01, dead, 0.0, goal[0], 0.0]), 5000)
    return Dataset(
        name="servo", t_input=t, u=goal, input_unit="rad", input_before=goal[0], t_output=t,
        y=(np.floor(angle / QUANTUM) + 0.5) * QUANTUM, output_unit="rad", kind="position", source=Source(name="servo"),
        quantum=QUANTUM,
    )  # fmt: skip


@pytest.mark.parametrize("p", [RINGING, CREEPING], ids=["ringing", "creeping"])
def test_the_response_is_that_of_very_short_steps(p: NDArray[np.float64]) -> None:
    found, _ = response(p, friction=True, speed=False)
    coarse, fine = (np.abs(march(goals(), p, substeps) - found).max() for substeps in (500, 2000))
    # A reversal within a step of 2.5 µs is off by half a step of 2 κ δ/τ = 15 rad/s²: 5e-8 rad and a few 1e-6 rad of the
    # implicit first-order step, which is the error that a fourth of the step makes a fourth.
    assert fine < 3e-5
    assert coarse / fine == pytest.approx(4.0, rel=0.15)


@pytest.mark.parametrize("speed", [False, True])
@pytest.mark.parametrize("friction", [False, True])
@pytest.mark.parametrize("p", [RINGING, CREEPING], ids=["ringing", "creeping"])
@pytest.mark.parametrize("column", range(kernels.COLUMNS))
def test_sensitivities_are_the_derivatives_of_the_response(
    column: int, p: NDArray[np.float64], friction: bool, speed: bool
) -> None:
    p = p.copy()
    p[kernels.DELAY] = (
        0.0021  # no change of the goal falls on a sample, where the speed's derivative by the delay jumps
    )
    step = 1e-6 * max(abs(p[column]), 1e-3)
    up, down = p.copy(), p.copy()
    up[column] += step
    down[column] -= step
    difference = (response(up, friction, speed)[0] - response(down, friction, speed)[0]) / (2 * step)
    jacobian = response(p, friction, speed)[1][:, column]
    # Rounding of 1e-15 of the response over a step of 1e-9 is 1e-6 in units of the Jacobian's own size.
    assert np.abs(difference - jacobian).max() <= 2e-6 * np.abs(jacobian).max() + 1e-6


def test_critical_damping_is_the_limit_from_either_side() -> None:
    """κ = 1/(4τ): the closed forms divide by zero there, and the limit is θ = 1 - (1 + h/(2τ)) e^(-h/(2τ))."""
    t = STEP * np.arange(200)
    tau = 0.1
    p = np.array([0.25 / tau, tau, 0.0, 0.0, 0.0, 0.0, 0.0])
    y, jacobian = np.empty(200), np.empty((200, kernels.COLUMNS))
    kernels.response(t[:1], np.ones(1), 0.0, t, p, 0.0, 0.0, ALL, y, jacobian)
    x = t / (2 * tau)
    np.testing.assert_allclose(y, 1 - (1 + x) * np.exp(-x), atol=1e-12)


@pytest.mark.parametrize(("loop", "tau", "dead"), [(15.0, 0.08, 0.03), (15.0, 0.02, 0.01)])
def test_loop_gain_time_constant_and_dead_band_are_found(loop: float, tau: float, dead: float) -> None:
    result = identify(servo(loop=loop, tau=tau, dead=dead), structure="position_loop_coulomb")

    assert result.fit is not None
    expected = {
        "loop_gain": loop,
        "time_constant": tau,
        "dead_band_position": dead,
        "offset_position": 0.01,
        "delay": 0.0,
    }
    for name, value in expected.items():
        # 4.5 standard deviations: one seed in 100,000 that is none of the code's fault.
        assert abs(result.fit[name].value - value) < 4.5 * result.fit[name].sd, name
    assert result.verdict is Verdict.TRUSTED
    system = result.fit.model.transfer_function("position")
    assert system.numerator[0] == system.denominator[-1]  # the position follows the goal one to one


def test_a_chain_is_in_the_prediction_and_its_jacobian() -> None:
    chain = Chain.parse("derivative | lowpass 50 rad/s")
    raw = servo()
    data = replace(
        raw, y=chain(raw.y, raw.t_output), kind="speed", output_unit="rad/s", quantum=None, applied=chain
    )
    structure = STRUCTURES["position_loop_coulomb"]
    theta = np.array([15.0, 0.08, 0.03, 0.01, 0.0021, raw.y[0], 1.0])
    prediction = structure.predict(theta, data)

    for n in range(len(theta)):
        step = 1e-6 * max(abs(theta[n]), 1e-3)
        up, down = theta.copy(), theta.copy()
        up[n] += step
        down[n] -= step
        difference = (structure.predict(up, data).y - structure.predict(down, data).y) / (2 * step)
        # The derivative over 5 ms makes 200 times the rounding of the position, 1e-15/1e-9.
        error = np.abs(difference - prediction.jacobian[:, n]).max()
        assert error <= 2e-6 * np.abs(prediction.jacobian[:, n]).max() + 3e-4, n


def test_a_rest_tells_its_position_once() -> None:
    """The shaft rests at most of its goals, rounded the same way in all samples of a rest: 20 rests, not 2000 samples.

    Taken for 2000, the stated deviation would be Q/√(12·2000), and the true errors some four of it. Of six errors in their own
    deviations the mean square exceeds 3.09 in 1 case of 200 (χ² of 6).
    """
    squares = []
    for seed in range(3, 9):
        result = identify(servo(seed), structure="position_loop_coulomb")
        assert result.fit is not None
        offset = result.fit["offset_position"]
        squares.append(((offset.value - 0.01) / offset.sd) ** 2)
    assert np.mean(squares) < 3.09


def test_a_loop_that_rings_faster_than_the_samples_is_no_prediction() -> None:
    structure = STRUCTURES["position_loop_coulomb"]
    data = servo()
    fast = np.array([4e5, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0])  # √(4e5/0.1) = 2000 rad/s, π/5 ms = 628 rad/s

    assert np.isnan(structure.predict(fast, data).y).all()


def test_a_goal_that_never_changes_is_refused() -> None:
    data = servo()
    still = replace(data, u=np.full_like(data.u, 0.3), input_before=0.3)

    with pytest.raises(NotIdentifiable, match="the goal stays"):
        STRUCTURES["position_loop"].guesses([still])


def test_a_position_that_follows_its_input_is_taken_for_a_loops() -> None:
    finding = goal_finding(servo())

    assert finding is not None
    assert finding.code == "input-is-a-goal"
    assert "position_loop" in finding.sentence


def test_a_load_that_holds_the_shaft_off_its_goal_is_reported() -> None:
    data = servo()
    finding = goal_finding(replace(data, y=0.4 * data.y))

    assert finding is not None
    assert "gravity" in finding.sentence


def test_a_motor_on_a_voltage_or_on_an_unrelated_angle_follows_nothing() -> None:
    motor = dataset(seed=3, kind="prbs")

    assert goal_finding(motor) is None
    assert goal_finding(replace(motor, input_unit="rad")) is None


def test_noise_on_a_goal_that_rests_at_its_mean_hides_no_loop() -> None:
    goal = np.tile(np.repeat([0.0, 30.0, 0.0, -30.0], 500), 3)
    lag = np.exp(-0.002 / 0.3)
    y = np.array(list(accumulate(goal, lambda before, to: to + lag * (before - to))))
    noisy = goal + 0.03 * np.random.default_rng(1).standard_normal(len(goal))

    assert goal_finding(replace(dataset(seed=1, samples=len(y), u=noisy, y=y), input_unit="rad")) is not None


@pytest.mark.parametrize("periods", [4.0, 16.0])
def test_a_sine_that_drives_a_motor_is_more_than_a_quarter_of_a_period_ahead_and_no_goal(
    periods: float,
) -> None:
    """Command and position in counts: any sine follows any other of its frequency, with the right lag."""
    u = 100.0 * np.sin(2 * np.pi * periods * np.arange(4000) / 4000)
    motor = replace(dataset(seed=1, samples=4000, u=0.03 * u), u=u, input_unit="counts", output_unit="counts")

    assert goal_finding(motor) is None
