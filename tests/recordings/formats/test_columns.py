import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from servobench.core.units import is_unit
from servobench.recordings.formats.columns import (
    Column,
    Heading,
    bare_name,
    distinct,
    heading,
    quote,
    recording_of,
)
from servobench.recordings.recording import Recording, Source
from tests.recordings.formats.tables import codes

RISING = np.arange(10.0)


def table(*headers: str, **values: np.ndarray) -> Recording:
    """A recording of columns that all rise, unless their values are given by name."""
    columns = [Column(heading=heading(text), values=values.get(text, RISING)) for text in headers]
    return recording_of(columns, name="made up", source=Source(name="made up"))


@pytest.mark.parametrize(
    ("text", "name", "unit"),
    [
        ("omega [rad/s]", "omega", "rad/s"),
        ("speed (deg/s)", "speed", "deg/s"),
        ("theta{deg}", "theta", "deg"),
        ("y <m>", "y", "m"),
        ("u / V", "u", "V"),
        ("u/V", "u", "V"),
        ("omega / rad/s", "omega", "rad/s"),
        ("omega in rad/s", "omega", "rad/s"),
        ("Speed, rpm", "Speed", "rpm"),
        ("Drehzahl [1/min]", "Drehzahl", "1/min"),
        ("n / 1/min", "n", "1/min"),
        ("gain (rad/(s·V))", "gain", "rad/(s·V)"),
        ("ratio [-]", "ratio", "1"),
        ("  spread \t  out  [V] ", "spread out", "V"),
        ("theta (filtered) [rad]", "theta (filtered)", "rad"),
        ("speed (filtered)", "speed (filtered)", None),
        ("m/s", "m/s", "m/s"),
        ("I/O", "I/O", None),
        ("a]", "a]", None),
        ("t_ms", "t_ms", "ms"),
        ("duty_%", "duty_%", "%"),
        ("Duty Cycle %", "Duty Cycle %", "%"),
        ("speed (%)", "speed", "%"),
        ("t_s", "t_s", "s"),
        ("x_s", "x_s", None),
        ("x_m", "x_m", None),
        ("m_s", "m_s", None),  # the mass of something
        ("u_V", "u_V", "V"),
        ("u_v", "u_v", None),
        ("u_volts", "u_volts", "V"),
        ("u_millivolts", "u_millivolts", "mV"),
        ("motor_voltage_v", "motor_voltage_v", "V"),
        ("back_emf_mv", "back_emf_mv", "mV"),
        ("voltage_V", "voltage_V", "V"),
        ("Voltage_mV", "Voltage_mV", "mV"),
        ("motor_v", "motor_v", None),  # may be its velocity
        ("u_mv", "u_mv", None),  # may be the manipulated variable
        ("wheel_speed_rad_s", "wheel_speed_rad_s", "rad/s"),
        ("motor_current_mA", "motor_current_mA", "mA"),
        ("encoder_A", "encoder_A", None),  # the first of two tracks
        ("RPM", "RPM", "rpm"),
        ("left_speed_ms", "left_speed_ms", "m/s"),
        ("wheelSpeed_ms", "wheelSpeed_ms", "m/s"),
        ("velocidad_ms", "velocidad_ms", "m/s"),
        ("vel_left_m_s", "vel_left_m_s", "m/s"),
        ("average_speed_mps", "average_speed_mps", "m/s"),
        ("speed_loop_ms", "speed_loop_ms", "ms"),
        ("velocity_dt_ms", "velocity_dt_ms", "ms"),
        ("speed_timestamp_ms", "speed_timestamp_ms", "ms"),
        ("travel_ms", "travel_ms", "ms"),  # how long a travel took
        ("Time (Milliseconds)", "Time", "milliseconds"),
        ("Time (Seconds)", "Time", "seconds"),
        ("Time [MS]", "Time", "ms"),
        ("Speed (Rad/s)", "Speed", "rad/s"),
        ("Voltage (Min)", "Voltage (Min)", None),
        ("I (Ma)", "I (Ma)", None),  # an array's name as well as a current's unit
        ("speed [ms]", "speed", "ms"),
        ("min", "min", None),
        ("", "", None),
        ("\x1b[31mred", "?[31mred", None),
    ],
)
def test_a_header_says_name_and_unit(text: str, name: str, unit: str | None) -> None:
    assert (heading(text).name, heading(text).unit) == (name, unit)


@given(text=st.text(max_size=20))
def test_any_header_has_a_name_that_can_be_printed_and_a_unit_that_is_one(text: str) -> None:
    said = heading(text)

    assert said.name.isprintable()
    assert said.unit is None or is_unit(said.unit)


@given(names=st.lists(st.sampled_from(["", "y", "y_2", "y_2_", "column_1", "column_2"]), max_size=8))
def test_names_are_made_to_differ_and_the_first_of_each_stays(names: list[str]) -> None:
    new, findings = distinct(names)

    assert len(set(new)) == len(names)
    assert "" not in new
    assert all(new[names.index(name)] == name for name in set(names) - {""})
    assert bool(findings) == (list(new) != names)


@pytest.mark.parametrize(
    ("name", "bare"),
    [
        ("theta_deg", "theta"),
        ("wheel_speed_rad_s", "wheel_speed"),
        ("t_s", "t"),
        ("current_A", "current"),
        ("motor_voltage_v", "motor_voltage"),
        ("encoder_A", "encoder_A"),
        ("left_speed_ms", "left_speed"),
        ("left_speed_m_s", "left_speed"),
        ("rpm", "rpm"),
        ("x_s", "x_s"),
    ],
)
def test_a_bare_name_has_no_unit_at_its_end(name: str, bare: str) -> None:
    assert bare_name(name) == bare


def test_long_lists_are_cut_and_control_characters_reach_no_terminal() -> None:
    assert quote(["\x1b[2J"]) == "`?[2J`"
    assert quote("abcd", most=2) == "`a`, `b` and 2 more"


@pytest.mark.parametrize(
    ("header", "factor"),
    [
        ("t", 1.0),
        ("Time", 1.0),
        ("time [ms]", 1e-3),
        ("timestamp (us)", 1e-6),
        ("time_ms", 1e-3),
        ("millis", 1e-3),
        ("t/min", 60),
        ("Tempo", 1.0),
        ("time(t)", 1.0),
        ("time_t_", 1.0),
        ("Time_ms_", 1e-3),
        ("time (millisec)", 1e-3),
        ("time [millis]", 1e-3),
        ("Tempo (milissegundos)", 1e-3),
        ("Zeit in Millisekunden", 1e-3),
        ("Time (UTC)", 1.0),
        ("ros_time_s", 1.0),
        ("loop_timestamp_ms", 1e-3),
    ],
)
def test_a_time_is_recognised_by_its_name_and_unit(header: str, factor: float) -> None:
    recording = table(header, "y")

    assert recording["y"].t is not None
    assert np.allclose(recording["y"].t, factor * RISING, rtol=1e-15)  # one rounding of a product
    assert {"time-recognised", "time-stated"} & set(codes(recording.findings))


@pytest.mark.parametrize(
    ("header", "code"),
    [
        ("t", "time-recognised"),
        ("Time", "time-recognised"),
        ("time [s]", "time-stated"),
        ("time_ms", "time-stated"),
    ],
)
def test_a_unit_that_the_heading_gives_is_no_convention(header: str, code: str) -> None:
    times = {each for each in codes(table(header, "y").findings) if each.startswith("time-")}

    assert times == {code}


@pytest.mark.parametrize(
    "header", ["timestamp", "clock", "x", "t [V]", "temperature", "time (Sek)", "time [jiffies]"]
)
def test_what_is_not_surely_a_time_is_not_taken_as_one(header: str) -> None:
    assert table(header, "y")["y"].t is None


def test_the_whole_name_of_a_time_comes_before_a_part_of_one() -> None:
    recording = table("time", "loop_time_ms", "y")

    assert recording["y"].t is not None
    assert "`time` is used as the time" in " ".join(each.sentence for each in recording.findings)


def test_of_two_times_none_is_taken_and_a_finding_asks() -> None:
    recording = table("t", "time", "y")

    assert recording["y"].t is None
    assert codes(recording.findings) == ["time-ambiguous"]


def test_a_column_that_does_not_increase_is_no_time_whatever_its_name() -> None:
    recording = table("t", "y", t=np.array([20.0, 20.1, 20.1, 20.0, 19.9, 20.0, 20.0, 20.1, 20.2, 20.0]))

    assert recording["y"].t is None
    assert codes(recording.findings) == ["time-not-recognised"]


def test_the_convention_for_seconds_is_reported_with_the_way_to_say_otherwise() -> None:
    (told,) = table("t", "y").findings

    assert "`time=t:ms`" in told.sentence
    assert "1 s" in told.sentence  # the median step, by which anybody sees a mistake


def test_columns_of_another_length_have_no_times() -> None:
    assert table("t", "y", y=np.arange(3.0))["y"].t is None


def test_a_unit_row_counts_more_than_the_convention() -> None:
    columns = [
        Column(heading=Heading(name="t", unit="ms"), values=RISING),
        Column(heading=Heading(name="y"), values=RISING),
    ]

    recording = recording_of(columns, name="made up", source=Source(name="made up"))

    assert recording["y"].t is not None
    assert recording["y"].t[-1] == pytest.approx(0.009, rel=1e-15)


@pytest.mark.parametrize(
    ("times", "why"),
    [
        (RISING[::-1], "it runs backwards; sort the rows"),
        (RISING[:1], "it has only one row"),
        (RISING * 0, "it stays the same from one row to the next 9 times"),
        (
            RISING[[0, 5, 2, 7, 1, 9, 3, 8, 4, 6]],
            "it goes back 4 times; sort the rows by it, the earliest first",
        ),
        (
            RISING[[0, 5, 2, 7, 1, 9, 3, 8, 4, 6]] ** 3,
            "sort the rows by it if they are only out of order; a computed",
        ),
    ],
)
def test_a_time_that_is_none_says_why(times: np.ndarray, why: str) -> None:
    (told,) = (f for f in table("t", t=times).findings if f.code == "time-not-recognised")

    assert why in told.sentence
