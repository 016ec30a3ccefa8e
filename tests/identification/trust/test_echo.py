"""An input that is the output once more drives nothing; that of a proportional controller does."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import servobench as sb
from servobench.core.channels import Array
from servobench.identification.trust.doubts.base import DOUBTS
from servobench.recordings.measurement.dataset import Dataset
from servobench.systems.control.pid import Pid


def codes(data: Dataset) -> set[str]:
    about = DOUBTS["echo"].about_data
    assert about is not None
    return {finding.code for finding in about([data])}


@pytest.fixture(scope="module")
def stepped() -> Dataset:
    """A step of the position from the first sample on, under u = 4 (r - θ): u is -4 θ and a constant."""
    asked = sb.Experiment(signal=sb.Step(initial=0, final=0.4), duration=2, controller=Pid(kp=4.0))
    with sb.connect("twin") as motor:
        return sb.measure(sb.run(asked, motor))


def test_a_proportional_controllers_voltage_is_no_echo_of_the_position(stepped: Dataset) -> None:
    # The counter begins anywhere within a step of the encoder, the position with half of one.
    assert np.abs(stepped.u + 4 * (stepped.y - 0.4)).max() < 4 * 2 * np.pi / 2048
    assert codes(stepped) == set()


def test_a_closed_loop_with_a_column_from_the_shaft_in_the_voltages_place_is_reported(
    stepped: Dataset,
) -> None:
    """It isn't zero where the position is at its reference."""
    assert codes(replace(stepped, u=7.5 * stepped.y + 1)) == {"input-is-output"}


def test_a_controllers_voltage_without_its_reference_is_doubted_and_not_refused(stepped: Dataset) -> None:
    """It drives the shaft to where it is zero itself."""
    assert codes(replace(stepped, reference=None)) == {"loop-proportional"}


@pytest.mark.parametrize("change", [lambda y: 7.5 * y, lambda y: -7.5 * y, lambda y: 7.5 * (0.8 - y)])
def test_without_a_reference_a_column_that_drives_the_shaft_nowhere_is_an_echo(
    stepped: Dataset, change: Callable[[Array], Array]
) -> None:
    assert codes(replace(stepped, reference=None, u=change(stepped.y))) == {"input-is-output"}


def test_an_input_that_is_called_the_reference_too_is_an_echo(stepped: Dataset) -> None:
    assert codes(replace(stepped, reference=stepped.u)) == {"input-is-output"}


def test_the_speed_once_more_is_an_echo_too(stepped: Dataset) -> None:
    speed = np.gradient(stepped.y, stepped.t_output)

    assert codes(
        replace(stepped, y=speed, kind="speed", output_unit="rad/s", quantum=None, u=0.3 * speed)
    ) == {"input-is-output"}


def test_a_motor_that_follows_a_ramp_is_no_echo_of_it(stepped: Dataset) -> None:
    """Of a ramp any motor's speed is a line as well, a little later: K (u - u_c) less its lag."""
    u = 10.0 * stepped.t_input / stepped.t_input[-1]
    speed = 20.0 * np.maximum(u - 0.05, 0.0) + 0.01 * np.random.default_rng(0).standard_normal(len(u))
    ramp = replace(
        stepped,
        u=u,
        y=speed,
        t_output=stepped.t_input,
        rows=None,
        kind="speed",
        output_unit="rad/s",
        quantum=None,
        reference=None,
    )
    assert abs(np.corrcoef(u, speed)[0, 1]) > 0.9999

    assert codes(ramp) == set()


@pytest.mark.parametrize(("gain", "tau", "told"), [(1.0, 0.05, True), (1.024, 0.2, False)])
def test_a_speed_that_passes_the_inputs_value_on_its_way_has_not_settled_there(
    stepped: Dataset, gain: float, tau: float, *, told: bool
) -> None:
    """Levels of ±10 V for a second, and K/(τ s + 1) behind them: at 1.024 rad/(s·V) the last 0.3 s of each are 9.9 on average."""
    t = np.arange(500) * 0.01
    u = np.where(t % 2.0 < 1.0, 10.0, -10.0)
    speed = np.zeros(len(t))
    for n in range(1, len(t)):
        speed[n] = speed[n - 1] + (gain * u[n - 1] - speed[n - 1]) * -np.expm1(-0.01 / tau)
    driven = replace(
        stepped,
        t_input=t,
        t_output=t,
        rows=None,
        u=u,
        y=speed,
        kind="speed",
        output_unit="rad/s",
        quantum=None,
        reference=None,
        current=None,
    )

    assert ("input-settles-at-output" in codes(driven)) == told
    assert "input-settles-at-output" not in codes(replace(driven, input_unit="%"))  # a duty is no speed


def test_rows_before_a_controller_begins_have_no_part_in_its_law(stepped: Dataset) -> None:
    """A first row without a voltage, and then one in proportion to the speed."""
    speed = np.gradient(stepped.y, stepped.t_output)
    u = np.where(np.arange(len(speed)) < 1, 0.0, 5.0 - 0.3 * speed)
    record = replace(stepped, y=speed, kind="speed", output_unit="rad/s", quantum=None, u=u, reference=None)

    assert codes(record) == {"input-is-output"}
