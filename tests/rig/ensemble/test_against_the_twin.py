"""The ensemble's lanes and the twin are the same motor, by two kernels that share no code."""

import numpy as np
import pytest

import servobench as sb
from servobench.core.channels import Array
from servobench.rig.devices.twin import Twin, TwinSettings
from servobench.rig.ensemble.motors import Motors
from servobench.rig.ensemble.simulation import Course, simulate
from servobench.rig.ensemble.tolerances import draw_motors, tolerances_of
from servobench.rig.motor.physics import Physics
from servobench.rig.motor.solvers.exact import coefficients
from servobench.systems.control.lead import Lead
from servobench.systems.control.pid import Pid
from servobench.systems.control.state_feedback import StateFeedback

STEPS = sb.PRBS(low=-3, high=3, order=6, bit_time="50 ms")
SPREAD = {"resistance": "20%", "motor_constant": "10%", "inertia": "20%"}
MOTORS = 3


def motors_of(twin: TwinSettings) -> Motors:
    tolerances = tolerances_of(twin, SPREAD)
    return Motors(parameters=draw_motors(twin, tolerances, MOTORS, 3), series=twin.amplifier_resistance)


def course_of(experiment: sb.Experiment, twin: TwinSettings) -> Course:
    every = np.arange(1, (experiment.samples or 0) + 1)
    return simulate(motors_of(twin), experiment, twin, seed=0, looks=every, recorded=True)


def twin_of(motors: Motors, number: int, twin: TwinSettings) -> TwinSettings:
    """A twin that is one of the motors; rotor, hub and disc are one inertia."""
    own = {name: float(values[number]) for name, values in motors.parameters.items()}
    inertia = own.pop("inertia")
    return twin.model_copy(update={**own, "rotor_inertia": inertia, "hub_inertia": 0.0, "disc_inertia": 0.0})


def speed_of(twin: TwinSettings, applied: Array, sample_time: float) -> Array:
    """The twin's hidden speed (N,) [rad/s] a tick after each voltage."""
    from servobench.rig.motor.kernels import simulate as by_twin

    dead_band = twin.dead_band or 0.0
    at_winding = applied - np.clip(applied, -dead_band, dead_band)
    out = np.empty((len(applied) + 1, 3))
    c = coefficients(Physics.of(twin.parameters, twin.amplifier_resistance), sample_time)
    by_twin(c, 0.0, 0.0, twin.start_angle, np.ascontiguousarray(at_winding), out)
    return out[1:, 1]


LINEAR = {
    "as it is": ({}, {}),
    "no inductance": ({}, {"inductance": 0.0}),
    "roots that are complex": ({}, {"inductance": 0.5}),
    "limit and dead band of the amplifier": ({}, {"dead_band": 0.6, "amplifier_limit": 2.5}),
    "limits of voltage and slew": (
        {"limits": {"slew": 100.0, "voltage": 2.0}},
        {"amplifier_resistance": 1.0},
    ),
    "a turned shaft": ({}, {"start_angle": 1.0}),
    "pid": ({"controller": Pid(kp=20.0, ki=3.0, kd=0.5)}, {}),
    "pid of the speed": ({"controller": Pid(output="speed", kp=0.1, ki=1.0)}, {"dead_band": 0.2}),
    "lead": ({"controller": Lead(gain=5.0, zero=10.0, pole=100.0)}, {}),
    "state feedback": (
        {"controller": StateFeedback(position_gain=5.0, speed_gain=0.2, reference_gain=5.0)},
        {"amplifier_limit": 4.0},
    ),
}


@pytest.mark.parametrize("kind", LINEAR)
def test_without_coulomb_friction_speed_and_counts_are_those_of_the_twin(kind: str) -> None:
    plan, settings = LINEAR[kind]
    experiment = sb.Experiment(signal=STEPS, duration=2.0, **plan)
    twin = TwinSettings(coulomb_torque=0.0, **settings)
    course = course_of(experiment, twin)
    assert course.counts is not None
    assert course.voltages is not None

    for number in range(MOTORS):
        own = twin_of(motors_of(twin), number, twin)
        with Twin(own) as device:
            run = sb.run(experiment, device)
        applied = run["applied"].values
        voltages = course.voltages if course.voltages.ndim == 1 else course.voltages[number]
        # Both are exact to rounding: 1000 sums of numbers up to 100 rad/s, each off by 1e-16 of it, fade within a time constant.
        assert np.abs(voltages - applied).max() < 1e-9
        assert (
            np.abs(course.states[1, :, number] - speed_of(own, applied, experiment.sample_time)).max() < 1e-9
        )
        assert np.array_equal(course.counts[number].astype(int), run["counts"].values)


def test_with_coulomb_friction_a_reversal_is_off_by_no_more_than_friction_does_in_a_tick() -> None:
    experiment, twin = sb.Experiment(signal=STEPS, duration=4.0), TwinSettings()
    course = course_of(experiment, twin)
    assert course.voltages is not None

    for number in range(MOTORS):
        own = twin_of(motors_of(twin), number, twin)
        truth = speed_of(own, course.voltages, experiment.sample_time)
        off = np.abs(course.states[1, :, number] - truth)
        # In a tick with a reversal friction acts with the wrong sign for a part of it: on the speed at most 2 T_c h/J. What is
        # left of it fades with the motor, and reversals within a time constant add up: here at most 2 in 0.1 s.
        inertia = float(motors_of(twin).parameters["inertia"][number])
        largest = 2 * own.coulomb_torque * experiment.sample_time / inertia
        assert off.max() < 2 * largest
        assert off.max() > 1e-3  # it isn't the twin's own kernel

    slower = sb.Experiment(signal=STEPS, duration=4.0, sample_time=experiment.sample_time / 8)
    finer = course_of(slower, twin)
    assert finer.voltages is not None
    own = twin_of(motors_of(twin), 0, twin)
    rough = speed_of(own, course.voltages, experiment.sample_time)
    fine = speed_of(own, finer.voltages, slower.sample_time)
    # First order: an eighth of the tick, an eighth of the error, within a factor of two for where in a tick the shaft turns back.
    assert np.sqrt(np.mean((finer.states[1, :, 0] - fine) ** 2)) < 0.25 * np.sqrt(
        np.mean((course.states[1, :, 0] - rough) ** 2)
    )


def test_a_shaft_that_friction_holds_stays_where_it_is() -> None:
    # 0.1 V through 8.4 Ω and 0.042 N·m/A are 5e-4 N·m, less than the Coulomb torque of 8e-4 N·m.
    experiment = sb.Experiment(signal=sb.Constant(value="0.1 V"), duration=1.0)
    course = course_of(experiment, TwinSettings())

    assert not course.states[1].any()
    # The step's friction is even over a tick while the current still rises: it shifts the angle by less than 0.01 counts.
    assert np.abs(course.states[2]).max() < 0.01 * 2 * np.pi / 2048
    assert np.allclose(
        course.states[0, -1], 0.1 / motors_of(TwinSettings()).parameters["resistance"], rtol=1e-9
    )
