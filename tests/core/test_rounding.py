import math

import pytest

from servobench.core.rounding import (
    as_known,
    change_text,
    count_text,
    handy_unit,
    instead_of,
    percent,
    plain,
    round_value,
    rounded_interval,
    share_explained,
    with_unit,
)


@pytest.mark.parametrize(
    ("value", "half", "unit", "text"),
    [
        (23.6965949, 0.000161, "rad/(s·V)", "23.69659 ± 0.00016 rad/(s·V)"),
        (1748.87, 123.0, "deg/s", "1750 ± 120 deg/s"),
        (0.0991539, 0.0000078, "s", "99.1539 ± 0.0078 ms"),
        (0.00014456, 7.8e-6, "s", "0.1446 ± 0.0078 ms"),
        (-1.143e-6, 4.5e-7, "V", "−1.14 ± 0.45 µV"),
        (0.0005, 0.00002, "m/(s·V)", "(0.500 ± 0.020) ×10⁻³ m/(s·V)"),
        (12.0, 0.0996, "V", "12.00 ± 0.10 V"),  # 0.0996 has its first digit in the tenths once it's rounded
        (0.001, 0.3, "V", "0.00 ± 0.30 V"),
        (0.1604, math.inf, "V", "0.1604 V"),
        (2.0, 0.0, "V", "2 ± 0 V"),
    ],
)
def test_a_value_has_the_digits_that_its_interval_leaves_it(
    value: float, half: float, unit: str, text: str
) -> None:
    assert str(round_value(value, half, unit)).replace("\u00a0", " ") == text


def test_both_ends_of_an_interval_have_the_decimals_of_the_value() -> None:
    estimate = round_value(0.16, 0.000012, "V")

    assert (estimate.value, estimate.low, estimate.high) == ("0.160000", "0.159988", "0.160012")


@pytest.mark.parametrize(
    ("value", "interval", "cells"),
    [
        (0.0991539, (0.0991461, 0.0991617), ("99.1539", "0.0078", "99.1461", "99.1617", "ms")),
        # The value is above 0.1 s and the middle of its interval below: both stay in one unit.
        (0.104, (0.024, 0.143), ("0.104", "", "0.024", "0.143", "s")),
        # 62 ± 15 ms would be 47 to 77.
        (0.062, (0.040, 0.070), ("62", "", "40", "70", "ms")),
        (12.6, (0.0, 1_720_000.0), ("13", "", "0", "1720000", "s")),
        (0.0, (0.0, 0.003), ("0.0", "", "0.0", "3.0", "ms")),
        (2.0, (2.0, 2.0), ("2", "0", "2", "2", "s")),
        (0.1604, (-math.inf, math.inf), ("0.1604", "", "", "", "s")),
        (0.1604, (math.nan, math.nan), ("0.1604", "", "", "", "s")),
    ],
)
def test_an_interval_has_the_unit_of_its_value_and_a_half_only_where_it_lies_evenly(
    value: float, interval: tuple[float, float], cells: tuple[str, ...]
) -> None:
    told = rounded_interval(value, interval, "s")

    assert (told.value, told.half, told.low, told.high, told.unit) == cells


def test_an_uneven_interval_stands_in_brackets() -> None:
    assert str(rounded_interval(0.062, (0.040, 0.070), "s")).replace("\u00a0", " ") == "62 (40 to 70) ms"


def test_no_end_of_an_interval_is_rounded_past_its_value() -> None:
    shown = rounded_interval(0.000501, (0.0005009, 0.027), "s")

    assert float(shown.low) <= float(shown.value) <= float(shown.high)


def test_an_interval_below_the_precision_of_a_double_makes_no_digits_up() -> None:
    assert round_value(23.7, 1e-18, "V").value == "23.70000000000"


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (-0.00012, "−0.00012"),
        (1234.5, "1234"),  # half to even
        (123456.0, "123456"),
        (12345678.0, "1.235×10⁷"),
        (1.2e-9, "1.2×10⁻⁹"),
        (9.9999, "10"),
        (math.nan, "unknown"),
        (-math.inf, "−∞"),
    ],
)
def test_a_plain_number_has_four_digits_at_the_most(value: float, text: str) -> None:
    assert plain(value) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (99.9978, "99.9978"),
        (80.36, "80.4"),
        (-35.0, "\u221235.0"),
        (100.0, "100"),
        (99.949, "99.949"),
        (5.0, "5.0"),
    ],
)
def test_a_percentage_becomes_100_only_where_it_is_100(value: float, text: str) -> None:
    assert percent(value) == text


def test_a_unit_that_takes_no_prefix_gets_a_power_of_ten() -> None:
    assert handy_unit("rad", 1.5e-3) == (1e-3, "mrad")
    assert handy_unit("counts", 2e6) == (1e6, "×10⁶ counts")
    assert handy_unit("counts", 131072.0) == (1.0, "counts")


def test_a_number_and_its_unit_stay_on_one_line() -> None:
    assert with_unit(0.0041, "s") == "4.1\u00a0ms"
    assert count_text(1, "lag") == "1 lag"
    assert count_text(24841, "sample") == "24\u202f841 samples"


@pytest.mark.parametrize(
    ("value", "half", "rounded_to"),
    [
        (21.8676, 0.35, 21.87),
        (0.014522, 0.0037, 0.0145),
        (-0.0929, 0.0163, -0.093),
        (0.01275, 0.2, 0.013),
        (12345.6, 300.0, 12350.0),
        (1.23456789, 0.0, 1.23456789),
        (1.23456789, float("inf"), 1.23456789),
        (0.0, 0.1, 0.0),
    ],
)
def test_a_value_is_shown_to_two_digits_of_its_interval(value: float, half: float, rounded_to: float) -> None:
    assert as_known(value, half) == pytest.approx(rounded_to, rel=1e-12)


@pytest.mark.parametrize(("percent", "words"), [(42.3, "only 42 %"), (0.3, "nothing"), (-126.0, "nothing")])
def test_a_simulation_never_explains_less_than_nothing(percent: float, words: str) -> None:
    assert share_explained(percent) == words


@pytest.mark.parametrize(
    ("first", "second", "words"),
    [
        (22.214, 22.212, "22.21 s either way"),
        (22.21, 21.9, "22.21 s instead of 21.9 s"),
        (4.619e7, 21.9, "4.619×10⁷ s instead of 21.9 s"),
    ],
)
def test_a_number_is_not_held_against_one_that_is_printed_alike(
    first: float, second: float, words: str
) -> None:
    assert instead_of(first, second, unit="s") == words


@pytest.mark.parametrize(
    ("value", "usual", "expected"),
    [
        (7.637, 9.348, "18 % smaller"),
        (-7.637, -9.348, "18 % smaller"),
        (1.0004, 1.0, "0.04 % larger"),
        (2.5, 1.0, "2.5 times as large"),
        (0.04, 1.0, "25 times smaller"),
        (446064.0, 1.0, "more than a hundred times as large"),
        (1.0, 446064.0, "more than a hundred times smaller"),
        (1.0, 1.0, "the same"),
        (-1.0, 1.0, "of the other sign"),
        (1.0, 0.0, "of the other sign"),
    ],
)
def test_a_change_has_no_size_but_its_own(value: float, usual: float, expected: str) -> None:
    assert change_text(value, usual) == expected
