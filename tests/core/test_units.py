"""Units: what they are worth, what they measure, and what is no unit."""

import math
from decimal import Decimal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from servobench.core.errors import UnitError
from servobench.core.units import convert, is_unit, quantity, unit

NUMBERS = st.floats(allow_nan=False, allow_infinity=False, min_value=-1e12, max_value=1e12)
SPEEDS = ["rad/s", "deg/s", "rpm", "rev/s", "Hz", "kHz", "mrad/s", "r/min", "dps"]
INERTIAS = ["kg·m²", "g·cm²", "kg*mm^2", "mN·m·s²", "J·s^2"]


@pytest.mark.parametrize(
    ("text", "factor"),
    [
        ("rad/s", 1),
        ("deg/s", math.pi / 180),
        ("rpm", 2 * math.pi / 60),
        ("Hz", 2 * math.pi),
        ("r/min", 2 * math.pi / 60),
        ("mH", 1e-3),
        ("g*cm^2", 1e-7),
        ("g·cm²", 1e-7),
        ("g cm2", 1e-7),
        ("g.cm**2", 1e-7),
        ("N·mm", 1e-3),
        ("mNm", 1e-3),
        ("min", 60),
        ("kΩ", 1e3),
        ("kOhm", 1e3),
        ("µs", 1e-6),
        ("μs", 1e-6),
        ("us", 1e-6),
        ("rad·s⁻¹", 1),
        ("rad.s-1", 1),
        ("s^-2", 1),
        ("√Hz", math.sqrt(2 * math.pi)),
        ("m/(s·mV)", 1e3),
        ("m/s/mV", 1e3),
        ("1/ms", 1e3),
        ("counts per rev", 1 / (2 * math.pi)),
        ("in/s", 0.0254),
        ("in/min", 0.0254 / 60),
    ],
)
def test_a_unit_is_worth_so_much_in_si(text: str, factor: float) -> None:
    assert unit(text).factor == pytest.approx(factor, rel=1e-14)


@pytest.mark.parametrize(
    ("text", "measures", "si"),
    [
        ("ms", "time", "s"),
        ("mV", "voltage", "V"),
        ("W/A", "voltage", "V"),
        ("mA", "current", "A"),
        ("%", "duty", "%"),
        ("deg", "position", "rad"),
        ("mm", "position", "m"),
        ("ticks", "position", "counts"),
        ("rpm", "speed", "rad/s"),
        ("km/h", "speed", "m/s"),
        ("counts/s", "speed", "counts/s"),
        ("mN·m", "torque", "N·m"),
        ("kN", "force", "N"),
        ("V/s", "other", "V/s"),
        ("g·cm²", "other", "kg·m^2"),
        ("1/ms", "other", "s^-1"),
        ("√kHz", "other", "s^-0.5·rad^0.5"),
    ],
)
def test_a_unit_measures_one_thing_and_has_an_si_unit(text: str, measures: str, si: str) -> None:
    assert (unit(text).quantity, unit(text).si) == (measures, si)


@pytest.mark.parametrize(
    ("spelled", "symbol"),
    [
        ("seconds", "s"), ("volts", "V"), ("milliamps", "mA"), ("degrees per second", "deg/s"), ("revolutions", "rev"),
        ("\u2126", "ohm"), ("\u03a9", "ohm"), ("henries", "H"), ("hertz", "Hz"), ("radians/sec", "rad/s"), ("RPM", "rpm"),
        ("°/s", "deg/s"), ("newton metres", "N·m"), ("cycles/s", "Hz"), ("rps", "rev/s"), ("pulses", "counts"),
    ],
)  # fmt: skip
def test_a_unit_may_be_spelled_out(spelled: str, symbol: str) -> None:
    assert convert(1, spelled, symbol) == pytest.approx(1, rel=1e-14)


@pytest.mark.parametrize(
    "text",
    [
        "", " ", "/", "/s", "m/", "m//s", "m*/s", "(m", "m)", "()", "m^", "m^x", "^2", "m^0.5", "m^2^2", "2", "11",
        "0.5 m", "V-A", "°C", "°°", "V%V%x", "kmin", "mrev", "kkg", "per", "m per", "m^10", "km^400", "cm^-99999999999999",
        "furlong", "№", "\0", "(" * 70 + "m" + ")" * 70, "√" * 79, "m" * 10_000, "√",
    ],
)  # fmt: skip
def test_what_is_no_unit_is_refused_whatever_it_is(text: str) -> None:
    with pytest.raises(UnitError, match=r"isn't a (known )?unit"):
        unit(text)
    assert not is_unit(text)


@given(st.text(max_size=100))
def test_any_text_is_a_unit_or_is_refused(text: str) -> None:
    assert is_unit(text) in {True, False}


@given(st.text(alphabet="smVAkgHzradcountµΩ°%√²⁻1()/*·^.- ", max_size=20))
def test_a_text_of_unit_characters_is_a_finite_unit_or_is_refused(text: str) -> None:
    if is_unit(text):
        assert 0 < unit(text).factor < math.inf


@given(NUMBERS, st.sampled_from(SPEEDS), st.sampled_from(SPEEDS))
def test_there_and_back_is_where_it_was(value: float, there: str, back: str) -> None:
    # Two ratios and two products, each rounded once, and one ratio of factors that were rounded themselves.
    assert convert(convert(value, there, back), back, there) == pytest.approx(value, rel=1e-14, abs=1e-300)


@given(NUMBERS, st.sampled_from(INERTIAS), st.sampled_from(INERTIAS), st.sampled_from(INERTIAS))
def test_a_detour_leads_to_the_same_place(value: float, start: str, way: str, end: str) -> None:
    direct, detour = convert(value, start, end), convert(convert(value, start, way), way, end)

    assert detour == pytest.approx(direct, rel=1e-14, abs=1e-300)


@given(
    NUMBERS,
    st.sampled_from(
        [("ms", "s", -3), ("us", "s", -6), ("kHz", "Hz", 3), ("mN·m", "N·m", -3), ("g·cm²", "kg·m²", -7)]
    ),
)
def test_between_decimal_multiples_only_the_point_moves(value: float, units: tuple[str, str, int]) -> None:
    given_unit, si, shift = units

    assert quantity(f"{value!r} {given_unit}", si) == float(Decimal(repr(value)).scaleb(shift))


@given(NUMBERS, st.sampled_from(["s", "Hz", "V·s/rad", "N·m/√Hz", "rad", "counts/rev"]))
def test_a_quantity_written_in_its_own_unit_is_exactly_itself(value: float, si: str) -> None:
    assert quantity(f"{value!r} {si}", si) == value == quantity(value, si) == quantity(repr(value), si)


@pytest.mark.parametrize(
    ("given_text", "si", "expected"),
    [
        ("9 ms", "s", 0.009),
        ("0.4Hz", "Hz", 0.4),
        (" -1.5e-3\tkV ", "V", -1.5),
        (".5 V", "V", 0.5),
        ("5. V", "V", 5.0),
        ("+1 V", "V", 1.0),
        ("8 Hz", "rad/s", 16 * math.pi),
        ("50 rad/s", "Hz", 25 / math.pi),
        ("90 deg", "rad", math.pi / 2),
        ("1 N·m/A", "V·s/rad", 1.0),
        ("0.042 V·s", "V·s/rad", 0.042),
        ("2048 counts/rev", "counts/rev", 2048),
        ("3 1/s", "rad/s", 3.0),
        (7, "V", 7.0),
    ],
)
def test_a_quantity_is_read_in_the_unit_asked_for(given_text: str, si: str, expected: float) -> None:
    assert quantity(given_text, si) == pytest.approx(expected, rel=1e-15)


@pytest.mark.parametrize(
    ("given_value", "si", "message"),
    [
        ("10 A", "Hz", "'10 A' is a current; expected something in Hz (for example \"1 Hz\")"),
        ("10 kg", "Hz", "'10 kg': the unit measures something else; expected something in Hz"),
        ("3 1", "rad", "'3 1': the unit measures something else"),
        ("3 1/s", "Hz", "'3 1/s': the unit measures something else"),  # a rate of what? 3 rad/s or 3 turns
        ("1 1/s", "r/min", "the unit measures something else"),
        ("1 V·s", "V·s/deg", "the unit measures something else"),
        ("1 J", "rad", "'1 J' is a torque"),
        ("10 Hzz", "Hz", "did you mean 'Hz'?"),
        ("0,4 Hz", "Hz", "'0,4 Hz' has a comma; write a decimal point"),
        ("fast", "Hz", "'fast' isn't a number with a unit"),
        ("", "Hz", "'' isn't a number with a unit"),
        ("1e400 V", "V", "'1e400 V' is too large"),
        ("1e308 kV", "V", "'1e308 kV' is too large"),
        (10**400, "V", "a whole number of 401 digits is too large"),
        (True, "V", "True isn't a number with a unit"),
        (None, "V", "None isn't a number with a unit"),
        ([1.0], "V", "[1.0] isn't a number with a unit"),
        ("nan", "V", "'nan' isn't a number with a unit"),
        ("1 2 V", "V", "'1 2 V': '2 V' isn't a unit"),
    ],
)
def test_what_is_no_such_quantity_is_reported_with_what_was_expected(
    given_value: object, si: str, message: str
) -> None:
    with pytest.raises(UnitError) as caught:
        quantity(given_value, si)
    assert message in str(caught.value)
    assert f"expected something in {si}" in str(caught.value)


def test_things_that_measure_differently_are_not_converted() -> None:
    with pytest.raises(
        UnitError, match="'rad' can't be converted to 'counts': they measure different quantities"
    ):
        convert(1, "rad", "counts")


def test_german_revolutions_a_minute_are_rpm_and_u_alone_is_no_unit() -> None:
    assert convert(60, "U/min", "rev/s") == pytest.approx(1)
    assert not is_unit("U")


@pytest.mark.parametrize("symbol", ["1/min", "min^-1", "min-1", "min⁻¹"])
def test_a_rotational_frequency_without_its_turn_is_a_speed(symbol: str) -> None:
    assert convert(60, symbol, "rev/s") == pytest.approx(1)
