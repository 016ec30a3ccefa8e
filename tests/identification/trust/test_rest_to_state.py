"""A record that begins with the input on is asked about where the shaft may have rested before."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from servobench.cli.option_names import with_options
from servobench.core.finding import Finding
from servobench.identification.trust.doubts.base import about_data
from servobench.recordings.measurement.dataset import Dataset
from tests.datasets import dataset

TIME = 0.002 * np.arange(400)
RISING = 40.0 * (1 - np.exp(-TIME / 0.1))
TURNED = 40.0 * (TIME - 0.1 * (1 - np.exp(-TIME / 0.1)))
ON = np.full(len(TIME), 2.0)


def begun(y: NDArray[np.float64], kind: str = "speed", u: NDArray[np.float64] = ON) -> Dataset:
    """A record of an output in rad/s or rad, whose input before the first row isn't known."""
    unit = "rad/s" if kind == "speed" else "rad"
    made = dataset(seed=1, samples=len(y), u=u, y=y)
    return replace(made, kind=kind, output_unit=unit, quantum=None, input_before=float(u[0]))


def hints(data: Dataset) -> list[Finding]:
    return [each for each in about_data([data]) if each.code == "rest-to-state"]


@pytest.mark.parametrize(("y", "kind"), [(RISING, "speed"), (TURNED, "position")])
def test_a_start_under_an_input_that_is_on_already_is_asked_about(y: NDArray[np.float64], kind: str) -> None:
    (found,) = hints(begun(y, kind))

    assert "`starts_at_rest=True`" in found.sentence
    assert "say --starts-at-rest:" in with_options(found.sentence)


def test_the_first_level_has_to_hold_for_a_while() -> None:
    assert hints(begun(RISING, u=np.where(TIME < 0.4, 2.0, 1.0)))
    assert not hints(begun(RISING, u=np.where(TIME < 0.02, 2.0, 1.0)))


def test_nothing_is_asked_where_it_is_said_or_can_t_be() -> None:
    assert not hints(replace(begun(RISING), starts_at_rest=True))
    assert not hints(replace(begun(RISING), input_before=0.0))
    assert not hints(begun(RISING + 20.0))
    assert not hints(begun(RISING, u=np.where(TIME < 0.1, 0.0, 2.0)))


def test_a_coarse_position_does_not_look_like_rest() -> None:
    """A shaft at a steady speed of 0.3 counts a row."""
    counts = np.floor(0.3 * np.arange(len(TIME)))

    assert not hints(replace(begun(counts, "position"), quantum=1.0))


@pytest.mark.parametrize("kind", ["speed", "position"])
def test_a_rest_of_a_few_rows_only_is_asked_about(kind: str) -> None:
    y = np.concatenate([np.zeros(5), (RISING if kind == "speed" else TURNED)[:-5]])
    u = np.where(np.arange(len(TIME)) < 5, 0.0, 2.0)

    (hint,) = hints(begun(y, kind, u))
    assert hint.sentence.startswith("The input is on after a few rows, in which the shaft seems to stand.")
    assert not hints(begun(y + 20.0, "speed", u)), "it turned"
