"""An input that is the output once more drives nothing; that of a proportional controller does."""

from dataclasses import replace

import numpy as np
import pytest

import servobench as sb
from servobench.control.pid import Pid
from servobench.doubts.base import DOUBTS
from servobench.measurement.dataset import Dataset


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


def test_a_closed_loop_with_a_column_from_the_shaft_in_the_voltages_place_is_told(stepped: Dataset) -> None:
    """It isn't zero where the position is at its reference."""
    assert codes(replace(stepped, u=7.5 * stepped.y + 1)) == {"input-is-output"}


@pytest.mark.parametrize("reference", [None, "the input itself"])
def test_in_an_open_loop_an_echo_is_one_whatever_its_offset(stepped: Dataset, reference: str | None) -> None:
    held = None if reference is None else stepped.u

    assert codes(replace(stepped, reference=held)) == {"input-is-output"}


def test_the_speed_once_more_is_an_echo_too(stepped: Dataset) -> None:
    speed = np.gradient(stepped.y, stepped.t_output)

    assert codes(
        replace(stepped, y=speed, kind="speed", output_unit="rad/s", quantum=None, u=0.3 * speed)
    ) == {"input-is-output"}
