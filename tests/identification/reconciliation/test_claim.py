"""Claims as people write them: a value with its unit, and how exactly it was written."""

import pytest

from servobench.core.errors import UnknownName, UsageError
from servobench.identification.reconciliation.claim import Claim, last_digit_half_width


@pytest.mark.parametrize(
    ("text", "name", "value", "half"),
    [
        ("tau=0.13", "time_constant", 0.13, 0.005),
        ("tau=0.130", "time_constant", 0.13, 0.0005),
        ("τ = 130 ms", "time_constant", 0.13, 0.0005),
        ("time_constant=1.3e-1", "time_constant", 0.13, 0.005),
        ("tau=0.13±0.01", "time_constant", 0.13, 0.01),
        ("tau=130ms+-5ms", "time_constant", 0.13, 0.005),
        ("K=23.8", "gain", 23.8, 0.05),
        ("gain=-24", "gain", -24.0, 0.5),
        ("gain=.5", "gain", 0.5, 0.05),
    ],
)
def test_a_claim_is_known_to_half_a_unit_of_its_last_digit_unless_it_says_more(
    text: str, name: str, value: float, half: float
) -> None:
    claim = Claim.parse(text)

    assert (claim.name, claim.value) == (name, pytest.approx(value))
    assert claim.half_width == pytest.approx(half)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("0.13", "NAME=VALUE"),
        ("tau=", "NAME=VALUE"),
        ("tau=fast", "isn't a number"),
        ("tau=0.13 V", "voltage"),
        ("tau=0", "1e-09 to .* s"),
        ("tau=-0.1", "1e-09 to .* s"),
        ("gain=0", "either way"),
        ("gain=1e160", "either way"),
        ("tau=0.13±0", "above 0"),
        ("tau=0.13±0.01±0.02", "one ±"),
    ],
)
def test_what_is_no_claim_is_refused_with_what_was_expected(text: str, said: str) -> None:
    with pytest.raises(UsageError, match=said):
        Claim.parse(text)


def test_a_parameter_that_can_t_be_claimed_is_answered_with_those_that_can() -> None:
    with pytest.raises(UnknownName, match="tau"):
        Claim.parse("tua=0.13")


@pytest.mark.parametrize(
    ("value", "half"), [(8.4, 0.05), (0.042, 0.0005), (4.0e-6, 0.05e-6), (7.5, 0.05), (0.0, 0.0), (12.0, 0.5)]
)
def test_a_sheet_s_value_is_known_to_half_a_unit_of_its_last_digit(value: float, half: float) -> None:
    assert last_digit_half_width(value) == pytest.approx(half)


def test_a_claimed_friction_is_sent_to_where_its_interval_stands() -> None:
    with pytest.raises(UsageError, match=r"claimed Coulomb voltage.*servobench identify"):
        Claim.parse("coulomb_voltage=0.1298V")
