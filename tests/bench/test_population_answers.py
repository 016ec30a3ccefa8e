"""Single motors of the population whose results were once trusted and wrong; the causes have been mended.

The truth is that of the bench's own simulator, which shares nothing with the package.
"""

import pytest
from population_parts.judge import off
from population_parts.runs import outcome


@pytest.mark.parametrize(
    "number",
    [
        pytest.param(9, id="on a ramp from rest a delay of 11 s stood for friction"),
        pytest.param(27, id="on a ramp from rest a time constant of 1 s stood for friction"),
        pytest.param(332, id="a delay of whole samples more stood for friction on a ramp of stairs"),
        pytest.param(121, id="half a sample of a differenced speed was taken for the motor's delay"),
        pytest.param(175, id="the mean of a random torque, too small to be seen, was taken for an offset"),
        pytest.param(191, id="a torque that no test finds in a short record was taken for none"),
        pytest.param(285, id="a torque that no test finds behind noise was taken for none"),
        pytest.param(4106, id="a random torque hid a little friction from the simulation"),
        pytest.param(5032, id="of a hundred places along a ramp of stairs only one was asked"),
        pytest.param(5114, id="three guesses on the floor of one valley left another unseen"),
        pytest.param(8143, id="a negative friction to start from ended in none, and a gain 22 % low"),
        pytest.param(8174, id="the same beside a random torque"),
        pytest.param(6091, id="noise of a speed sensor turned a motor back that turns one way"),
        pytest.param(578, id="a slow drift took the rounding of a rest for motion, with a delay of 2.5 s"),
    ],
)
def test_nothing_that_is_stated_is_far_off(number: int) -> None:
    """Three standard deviations are the limit that the population is judged by."""
    row = outcome(number)

    assert row["verdict"] in ("trusted", "doubtful")
    assert row["estimates"]
    assert off(row) == {}


@pytest.mark.parametrize(
    "number",
    [
        pytest.param(
            18, id="a multisine that began with the record drove a motor that had not heard of it yet"
        ),
        pytest.param(41, id="a record of 40 rows began in mid-motion"),
        pytest.param(8123, id="a bit that lasted no longer than the delay came before the first motion"),
        pytest.param(8187, id="a search along a valley of kinks gave up"),
        pytest.param(294, id="rounding over a multisine was taken for model error"),
        pytest.param(254, id="a random torque hid that a speed was a difference of counts"),
    ],
)
def test_what_could_be_known_is_known_as_well(number: int) -> None:
    """Within three times the bound; each was once five to a million times as wide.

    The bound of motor 294 is a ten-millionth of its gain; there a thousandth is good enough.
    """
    row = outcome(number)

    for name in ("gain", "time_constant"):
        value, sd, *_ = row["estimates"][name]
        assert sd / abs(value) < max(3.0 * row["bound"][name], 1e-3)
    assert off(row) == {}


def test_a_motor_that_rests_for_most_of_a_multisine_is_found() -> None:
    """Its fit explained 60 %, with a gain of -4e6: where the shaft rests, the search took it for moving."""
    row = outcome(195)

    assert row["fit_percent"] > 99.9
    assert off(row) == {}
