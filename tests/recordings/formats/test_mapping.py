"""The meaning of each column: given, known, recognised or asked for."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from servobench.core.channels import Channel
from servobench.core.errors import FormatError, MissingInformation, UnitError, UnknownName, UsageError
from servobench.core.finding import Severity
from servobench.recordings.formats.base import load
from servobench.recordings.formats.mapping import Mapping, assign
from servobench.recordings.formats.proposal import proposal
from servobench.recordings.formats.roles import ColumnSpec
from servobench.recordings.recording import Recording, Series, Source
from tests.recordings.formats.tables import codes, finding, loaded
from tests.recordings.native.samples import small

RANDOM = np.random.default_rng(4)
T = 0.02 * np.arange(100)


def made(*names: str, t: np.ndarray | None = T, **units: str) -> Recording:
    """A recording with channels of those names, and units by name."""
    length = 100 if t is None else len(t)
    all_series = tuple(
        Series(channel=Channel(name=name, unit=units.get(name)), values=RANDOM.normal(size=length), t=t)
        for name in names
    )
    return Recording(name="made", series=all_series, source=Source(name="made.csv"))


def changed(recording: Recording, name: str, values: np.ndarray, t: np.ndarray | None) -> Recording:
    """The recording with other samples of one channel."""
    new = Series(channel=recording[name].channel, values=values, t=t)
    series = tuple(new if each.channel.name == name else each for each in recording.series)
    return Recording(name="made", series=series, source=recording.source)


def missing(recording: Recording, **given: str | float) -> tuple[str, ...]:
    """The sentences by which more is asked for."""
    with pytest.raises(MissingInformation) as caught:
        assign(recording, **given)  # type: ignore[arg-type]
    return caught.value.missing


@pytest.mark.parametrize(
    ("text", "column", "unit"),
    [
        ("y:deg/s", "y", "deg/s"),
        ("y", "y", None),
        ("a:b", "a:b", None),
        ("a:b:rad", "a:b", "rad"),
        ("log.y:rad", "log.y", "rad"),
        ("3:V", "3", "V"),
        ("C:\\logs\\x.csv#1:V", "C:\\logs\\x.csv#1", "V"),
        (":V", ":V", None),
        ("y:", "y:", None),
    ],
)
def test_what_follows_the_last_colon_is_a_unit_only_if_it_is_one(
    text: str, column: str, unit: str | None
) -> None:
    assert ColumnSpec.parse(text) == ColumnSpec(column=column, unit=unit)
    assert str(ColumnSpec.parse(text)) == text


def test_only_the_unit_of_the_output_has_to_be_said_of_t_u_y() -> None:
    assert missing(made("t", "u", "y")) == (
        "the unit of the output `y`: say `output=y:UNIT`, such as y:deg or y:deg/s",
    )

    assigned = assign(made("t", "u", "y"), output="y:deg/s")

    assert (assigned.input, assigned.output) == ("u", "y")
    assert (assigned["u"].channel.unit, assigned["y"].channel.unit) == ("V", "deg/s")
    assert "`input=" in finding(assigned.findings, "input-recognised").sentence


def test_all_that_is_missing_is_asked_for_at_once_each_with_its_option() -> None:
    asked = missing(made("Channel 1", "Channel 2", t=None))

    assert len(asked) == 3
    assert "`input=COL:UNIT`; the columns are `Channel 1`, `Channel 2`" in asked[0]
    assert "`output=COL:UNIT`" in asked[1]
    assert "`sample_time=SECONDS`" in asked[2]


@pytest.mark.parametrize("supply", ["batt_voltage", "vbatt", "battery_volts"])
def test_a_duty_is_asked_about_and_a_battery_is_not(supply: str) -> None:
    asked = missing(made("m_power", supply, "motor_velocity", motor_velocity="rad/s"))

    assert asked[0] == "which column is the input (perhaps `m_power`): say `input=m_power:UNIT`"


def test_the_error_names_the_file() -> None:
    with pytest.raises(MissingInformation, match=r"^made\.csv: information is missing"):
        assign(made("a", "b"))


def test_names_with_blanks_are_quoted_as_they_have_to_be_typed() -> None:
    (asked,) = missing(made("u", "shaft speed"))

    assert '`output="shaft speed:UNIT"`' in asked


def test_of_two_candidates_none_is_taken() -> None:
    assert missing(made("u", "theta", "omega", theta="rad", omega="rad/s")) == (
        "which column is the output (perhaps `theta`, `omega`): say `output=theta` or `output=omega`",
    )


def test_without_a_telling_name_those_that_measure_the_right_thing_are_asked_about() -> None:
    asked = missing(made("a", "b", "c", a="V", b="V", c="rad"))

    assert asked[0].endswith("say `input=a` or `input=b`")
    assert asked[1].endswith("say `output=c`")


@pytest.mark.parametrize(
    ("name", "unit", "role"),
    [
        ("u", None, "input"),
        ("Voltage", None, "input"),
        ("v", None, "input"),
        ("motor voltage", "V", "input"),
        ("rig.cmd", "%", "input"),
        ("Theta", "rad", "output"),
        ("ω", "rad/s", "output"),
        ("rig.motor-speed", "rpm", "output"),
        ("v", "m/s", "output"),
        ("theta_deg", "deg", "output"),
        ("pwmValue", "%", "input"),
        ("inputSignal(8bits)", "%", "input"),
        ("ex_signal(u)", "V", "input"),
        ("ex_signal_u_", "V", "input"),
        ("Tensão", "V", "input"),
        ("EncoderPosition", "counts", "output"),
        ("speed (raw)", "rad/s", "output"),
        ("system_response_y_", "rad/s", "output"),
        ("Saída", "rad/s", "output"),
        ("thetaDot", "rad/s", "output"),
        ("actual_rpm", "rpm", "output"),
    ],
)
def test_names_that_are_recognised(name: str, unit: str | None, role: str) -> None:
    other = ("speed", "rad/s", "output") if role == "input" else ("u", "V", "input")
    recording = made(name, other[0], **{other[0]: other[1]}, **({} if unit is None else {name: unit}))

    assigned = assign(recording)

    assert getattr(assigned, role) == name
    assert finding(assigned.findings, f"{role}-recognised").severity is Severity.INFO


@pytest.mark.parametrize(
    ("name", "unit"), [("supply", "V"), ("u", "rad"), ("battery_voltage", "V"), ("y", "V"), ("voltage", "s")]
)
def test_names_that_do_not_fit_their_unit_or_say_something_else_are_not_recognised(
    name: str, unit: str
) -> None:
    asked = missing(made(name, "column", **{name: unit}))

    assert len(asked) == 2


@pytest.mark.parametrize("said", ["omega [rad/s]", "omega", "2", "OMEGA", "omega:rad/s", "2:rad/s"])
def test_a_column_is_named_by_its_name_its_header_its_number_or_in_other_case(said: str) -> None:
    assigned = assign(made("u", "omega", "y", "x", omega="rad/s"), output=said)

    assert assigned.output == "omega"
    assert ("name-case" in codes(assigned.findings)) == (said == "OMEGA")


def test_a_column_that_must_be_the_time_is_asked_for_by_name() -> None:
    named = made("u", "y", "timestamp", t=None)
    named["timestamp"].values[:] = 1.75e9 + T
    unnamed = made("column_1", "column_2", t=None)
    unnamed["column_1"].values[:] = T
    rows = made("column_1", "column_2", t=None)
    rows["column_1"].values[:] = np.arange(100)

    assert "`timestamp` may be the time by its name: say `time=timestamp:s`" in missing(named)[-1]
    assert (
        "`column_1` may be the time as it grows from row to row: say `time=column_1:s`"
        in missing(unnamed)[-1]
    )
    assert "one of `column_1`, `column_2`" in missing(rows)[-1]  # it only counts them


def test_only_columns_without_a_role_are_offered_for_one() -> None:
    """The time and what is surely the output can't drive the motor."""
    asked = missing(made("time", "position", "a", "b", position="rad"))

    assert "the columns are `a`, `b`" in asked[0]
    assert "no column is left for it" in missing(made("time", "setpoint", "position", position="rad"))[0]


def test_counts_per_turn_say_that_an_output_without_a_unit_is_in_counts() -> None:
    assigned = assign(made("u", "encoder", u="V"), counts_per_rev=4096)

    assert assigned["encoder"].channel.unit == "counts"
    assert "`encoder` is read in counts" in finding(assigned.findings, "unit-by-convention").sentence


def in_two_columns(states: tuple[float, float]) -> Recording:
    """A duty without a sign, beside a column with one of two states, and a shaft that follows both."""
    back = (T // 0.5).astype(int) % 2 == 1
    duty = np.full(100, 40.0)
    angle = np.cumsum(np.where(back, -1.0, 1.0))
    recording = made("pwm", "dir", "angle", angle="deg")
    for name, values in {"pwm": duty, "dir": np.where(back, *states), "angle": angle}.items():
        recording[name].values[:] = values
    return recording


@pytest.mark.parametrize("states", [(-1.0, 1.0), (0.0, 1.0)])
def test_an_input_whose_sign_stands_in_another_column_is_asked_for_it(states: tuple[float, float]) -> None:
    recording = in_two_columns(states)
    (asked,) = missing(recording, input="pwm:%")
    assigned = assign(recording, input="pwm*dir:%")

    assert "pwm*dir:UNIT" in asked
    assert assigned.input == "pwm*dir"
    assert set(assigned["pwm*dir"].values) == {40.0, -40.0}
    assert "column-signed" in codes(assigned.findings)
    recording["angle"].values[:] = T  # a shaft that turns one way shows no sign
    assert assign(recording, input="pwm:%").input == "pwm"


@pytest.mark.parametrize(("state", "size"), [(1.0, 40.0), (-1.0, -40.0), (0.0, -40.0)])
def test_of_a_motor_that_is_driven_one_way_the_sign_has_one_state(state: float, size: float) -> None:
    assigned = assign(in_two_columns((state, state)), input="pwm*dir:%")

    assert set(assigned["pwm*dir"].values) == {size}


def test_a_column_of_one_state_is_nobodys_missing_sign() -> None:
    assert assign(in_two_columns((-1.0, -1.0)), input="pwm:%").input == "pwm"


def test_a_sign_is_a_column_of_two_states() -> None:
    with pytest.raises(UsageError, match="`b` can't be the sign of `u`"):
        assign(made("u", "y", "b", y="rad"), input="u*b:V")


def test_a_goal_is_reported_from_what_drives_the_motor() -> None:
    asked = missing(made("target_speed", "actual_speed", actual_speed="rpm"))

    assert "`target_speed` is, by its name, what a loop follows" in asked[0]


@pytest.mark.parametrize("name", ["ref", "ref_m_s", "target_speed", "Reference for left motor", "setpoint"])
def test_a_column_that_is_called_like_a_reference_is_asked_about(name: str) -> None:
    recording = made("u", "y", name, u="V", y="rad/s")

    (question,) = (each for each in assign(recording).findings if each.code == "reference-possible")

    assert f"`{name}` is, by its name, what a loop follows" in question.sentence
    assert question.severity is Severity.INFO
    said = assign(recording, reference=f"{name}:rad/s")
    assert said.reference == name
    assert "reference-possible" not in codes(said.findings)


@pytest.mark.parametrize("name", ["r_wheel", "desired_current", "target_pwm", "reflex", "battery"])
def test_another_column_is_not_asked_about_as_a_reference(name: str) -> None:
    recording = made("u", "y", name, u="V", y="rad/s")

    assert "reference-possible" not in codes(assign(recording).findings)


@pytest.mark.parametrize(
    ("name", "is_asked"), [("setpoint", True), ("ref_1", True), ("u", False), ("target_pwm", False)]
)
def test_an_input_that_is_called_like_a_reference_is_asked_about(name: str, is_asked: bool) -> None:
    recording = made(name, "y", y="rad/s")

    findings = assign(recording, input=f"{name}:V").findings

    asked = [each.sentence for each in findings if each.code == "reference-possible"]
    assert [f"The input `{name}` is, by its name, what a loop follows" in each for each in asked] == [
        True
    ] * is_asked


@pytest.mark.parametrize(
    ("names", "output", "other"),
    [
        (("DriveM1", "DriveM2", "RPM_M1", "RPM_M2"), "RPM_M2", "DriveM2"),
        (("DriveM1", "DriveM2", "RPM_M1", "RPM_M2"), "RPM_M1", None),
        (("pwm_left", "pwm_right", "speed_right"), "speed_right", "pwm_right"),
        (("voltL", "voltR", "velR"), "velR", "voltR"),
        (("pwm_left", "speed_right"), "speed_right", None),
        (("u", "y", "Y"), "y", None),
    ],
)
def test_the_input_of_another_motor_is_doubted_by_its_name(
    names: tuple[str, ...], output: str, other: str | None
) -> None:
    recording = made(*names)

    findings = assign(recording, input=f"{names[0]}:V", output=f"{output}:rad/s").findings

    doubts = [each.sentence for each in findings if each.code == "columns-of-two-motors"]
    assert [f"say `input={other}`" in each for each in doubts] == [True] * (other is not None)


def test_of_several_references_the_motors_own_is_asked_about() -> None:
    recording = made("TargetX", "TargetM1", "TargetM2", "DriveM2", "RPM_M2")

    findings = assign(recording, input="DriveM2:V", output="RPM_M2:rad/s").findings

    (question,) = (each.sentence for each in findings if each.code == "reference-possible")
    assert question.startswith("`TargetM2`")


def test_a_column_that_may_be_the_supply_of_a_duty_is_asked_about() -> None:
    recording = made("duty", "speed", "battery_V", duty="%", speed="rad/s", battery_V="V")

    (question,) = (each for each in assign(recording).findings if each.code == "supply-possible")

    assert "say `supply=battery_V`" in question.sentence
    assert "supply-possible" not in codes(assign(recording, supply="battery_V").findings)
    in_volts = made("u", "speed", "battery_V", u="V", speed="rad/s", battery_V="V")
    assert "supply-possible" not in codes(assign(in_volts).findings)


def test_a_command_in_the_unit_of_a_position_is_no_output() -> None:
    asked = " ".join(missing(made("command_deg", "gyro", command_deg="deg")))

    assert "which column is the input (perhaps `command_deg`)" in asked
    assert "which column is the output (what was measured" in asked


def test_what_was_commanded_and_what_was_applied_are_not_two_motors() -> None:
    asked = missing(made("command_voltage", "applied_voltage", "y", y="rad"))
    sides = missing(made("left_voltage", "right_voltage", "y", left_voltage="V", right_voltage="V", y="rad"))

    assert "motors" not in asked[0]
    assert "If there are several motors, choose one: `input=left`" in sides[0]


def test_a_side_is_offered_only_where_it_leads_to_one_column() -> None:
    names = ("left_pwm", "right_pwm", "left_pulses", "left_speed", "right_pulses", "right_speed")
    asked = missing(made(*names))

    assert asked[0].endswith("choose one: `input=left:UNIT`")
    assert assign(made(*names), input="left:%", output="left_pulses:counts").input == "left_pwm"
    assert asked[1].endswith("say `output=left_pulses:UNIT` or `output=right_pulses:UNIT`")
    with pytest.raises(UnknownName):
        assign(made(*names), input="left:%", output="left:counts")


def test_a_side_that_is_also_a_column_is_not_offered() -> None:
    asked = missing(made("left", "left_pwm", "right_pwm", "y", y="rad"))

    assert "several motors" not in asked[0]


def test_a_column_of_text_is_proposed_for_no_role(tmp_path: Path) -> None:
    words = "command,speed,time,battery [V],setpoint [rad],direction [deg]"
    rows = "".join(f"{10 * k},{k % 3},{k},go,up,now,full,left,none\n" for k in range(50))
    recording = loaded(tmp_path, f"a,left_pwm,left_pulses,{words}\n{rows}")

    asked = missing(recording)

    names = [word.partition(" ")[0] for word in words.split(",")]
    assert not [name for name in names for sentence in asked[:2] if f"`{name}`" in sentence]
    proposed = [line for line in proposal([recording]).splitlines() if " = " in line]
    assert not [line for line in proposed for name in names if f'"{name}' in line]


def test_columns_that_differ_by_a_number_are_called_by_their_whole_names() -> None:
    asked = missing(made("Channel 1", "Channel 2", "y", y="rad", **{"Channel 1": "V", "Channel 2": "V"}))

    assert '`input="Channel 1"` or `input="Channel 2"`' in asked[0]
    assert "`input=1`" not in asked[0]


def test_input_and_output_of_a_controllers_log_are_asked_for_and_not_taken_by_name() -> None:
    asked = missing(made("setpoint", "input", "output"))
    alone = missing(made("input", "output"))

    assert "`input` is what it measures, and `output` what drives the motor" in asked[0]
    assert "say `input=output:UNIT`, otherwise `input=input:UNIT`" in asked[0]
    assert "say `output=input:UNIT`" in asked[1]
    assert "what it measures" not in " ".join(alone)


def test_a_unit_said_under_another_name_of_it_is_no_contradiction() -> None:
    recording = made("u", "angle", angle="steps")

    assert "unit-overridden" not in codes(assign(recording, output="angle:counts").findings)
    assert "unit-overridden" in codes(assign(recording, output="angle:deg").findings)


def test_one_row_in_a_hundred_whose_time_is_spoilt_is_left_out_without_a_warning() -> None:
    t = np.arange(200) * 0.02
    t[0] = 1.0

    assigned = with_times(t)

    assert finding(assigned.findings, "rows-left-out").severity is Severity.INFO
    assert finding(assigned.findings, "rows-left-out").rows == (1, 1)


def test_an_exact_name_wins_over_a_number_and_a_unit() -> None:
    assigned = assign(made("2", "u", "a:s", **{"2": "rad", "a:s": "V"}), output="2", input="a:s")

    assert (assigned.output, assigned.input) == ("2", "a:s")
    assert assigned["a:s"].channel.unit == "V"


@pytest.mark.parametrize("said", ["z", "0", "4", "-1", "OM", "nowhere.csv#z"])
def test_a_column_that_is_not_there_is_an_error_that_lists_the_columns(said: str) -> None:
    with pytest.raises(UsageError, match=r"known: omega, u, y|no file nowhere.csv"):
        assign(made("u", "omega", "y"), output=f"{said}:rad")


def test_two_names_that_differ_in_case_only_are_not_taken_for_one_another() -> None:
    with pytest.raises(UnknownName):
        assign(made("u", "Yes", "yes"), output="YES:rad")


def test_a_side_is_the_one_channel_that_fits_the_role() -> None:
    names = ("left_voltage", "right_voltage", "left_position", "left_velocity", "right_velocity")
    units = dict(zip(names, ("V", "V", "rev", "rev/s", "rev/s"), strict=True))
    recording = made(*names, **units)

    assert assign(recording, input="left", output="left").output == "left_position"
    assert assign(recording, input="left", output="left:rev/s").output == "left_velocity"
    assert assign(recording, input="right", output="right").output == "right_velocity"
    assigned = assign(recording, input="left", output="left")
    assert codes(assigned.findings) == ["name-beginning", "name-beginning"]
    with pytest.raises(UnknownName):
        assign(recording, input="l", output="left")


def test_a_side_is_found_in_names_whose_words_only_capitals_part() -> None:
    recording = made(
        "time", "targetSpeed", "leftSpeed", "leftCommand", "rightSpeed", "rightCommand", time="s"
    )
    asked = missing(recording)

    assert "`input=leftCommand:UNIT` or `input=rightCommand:UNIT`" in asked[0]
    assert "If there are several motors, choose one: `input=left:UNIT`" in asked[0]
    assert "If there are several motors, choose one: `output=left:UNIT`" in asked[1]
    assigned = assign(recording, input="left:%", output="left:rpm")
    assert (assigned.input, assigned.output) == ("leftCommand", "leftSpeed")


def test_a_side_without_a_unit_is_asked_for_the_unit_of_its_channel() -> None:
    recording = made("time", "leftSpeed", "leftCommand", "rightSpeed", "rightCommand", time="s")

    asked = missing(recording, input="left", output="left")

    assert "leftCommand" in asked[0]
    assert "unit" in asked[0]


def test_a_word_in_front_of_one_motors_name_alone_tells_nothing_apart() -> None:
    asked = missing(made("leftSpeed", "rearTemperature", "leftCommand"))

    assert not any("several motors" in each for each in asked)


def test_what_a_run_of_ours_knows_need_not_be_said_and_nothing_changes() -> None:
    ours = assign(small(), output="counts:counts")

    assert assign(ours) == ours
    assert ours["counts"].channel == Channel(name="counts", unit="counts")


def test_what_is_said_comes_before_what_the_file_says() -> None:
    assigned = assign(
        made("u", "theta", "aux", u="V", theta="rad"), input="aux:%", output="theta:deg", chain=" scale 2 "
    )

    assert (assigned.input, assigned["aux"].channel.unit) == ("aux", "%")
    assert assigned["theta"].channel.unit == "deg"
    assert "deg instead of rad" in finding(assigned.findings, "unit-overridden").sentence
    assert assigned.chain == "scale 2"
    assert assign(small(), output="counts:counts").chain == small().chain


def test_limits_and_resolution_do_not_survive_another_unit() -> None:
    channel = Channel(name="y", unit="rad", minimum=-1.0, resolution=0.1)
    recording = made("u", "y")
    recording = Recording(
        name="made",
        series=(recording["u"], Series(channel=channel, values=T, t=T)),
        source=recording.source,
    )

    assert assign(recording, output="y")["y"].channel == channel
    assert assign(recording, output="y:deg")["y"].channel == Channel(name="y", unit="deg")


@pytest.mark.parametrize(
    ("given", "why"),
    [
        ({"output": "y:V"}, "the output `y` is in V; expected a position"),
        ({"output": "y:s"}, "the output `y` is in s; expected a position"),
        ({"input": "u:ms", "output": "y:rad"}, "the input `u` is in ms; expected V"),
        ({"input": "y:V", "output": "y:rad"}, "`y` can't be both input and output"),
        ({"output": "y:rad", "time": "y:ms"}, "`y` was named as the time, so it can't be the output too"),
        ({"output": "y:rad", "time": "t:V"}, "the time `t` is in V; expected s"),
        ({"output": "y:rad", "time": "t:s", "sample_time": 0.1}, "give one of them"),
        ({"output": "y:rad", "sample_time": 0.0}, "expected a positive number"),
        ({"output": "y:rad", "sample_time": float("nan")}, "expected a positive number"),
        ({"output": "y:rad", "sample_time": True}, "expected seconds"),
        ({"output": "y:rad", "sample_time": "5 V"}, "expected something in s"),
    ],
)
def test_what_cannot_be_so_is_an_error(given: dict[str, str | float], why: str) -> None:
    with pytest.raises((UsageError, UnitError), match=why):
        assign(made("t", "u", "y"), **given)  # type: ignore[arg-type]


@pytest.mark.parametrize("said", [0.005, "5 ms", "0.005"])
def test_a_sample_time_makes_even_times_in_place_of_those_of_the_file(said: float | str) -> None:
    assigned = assign(made("u", "y"), output="y:rad", sample_time=said)

    assert np.array_equal(assigned["u"].t, 0.005 * np.arange(100))
    assert np.array_equal(assigned["y"].t, 0.005 * np.arange(100))
    assert "aren't used" in finding(assigned.findings, "sample-time-given").sentence


def test_a_time_column_is_converted_and_findings_on_other_times_are_dropped(tmp_path: Path) -> None:
    recording = loaded(tmp_path, "t,tick,u,y\n0,0,1,2\n0,20,1,3\n1,40,1,4\n2,60,1,4\n")
    assert "time-duplicate" in codes(recording.findings)

    assigned = assign(recording, time="tick:ms", output="y:rad")

    assert assigned["y"].t is not None
    assert np.allclose(assigned["y"].t, [0.0, 0.02, 0.04, 0.06], rtol=1e-15)
    assert codes(assigned.findings) == ["input-recognised"]


def test_a_time_column_whose_unit_nobody_says_is_asked_about() -> None:
    assert missing(made("tick", "u", "y", t=None), time="tick", output="y:rad") == (
        "the unit of the time `tick`: say `time=tick:s`, or :ms, or what it is",
    )


def test_a_time_column_of_another_length_is_an_error() -> None:
    recording = changed(made("tick", "u", "y", t=None), "tick", np.arange(3.0), None)

    with pytest.raises(UsageError, match="has 3 samples and the input `u` has 100"):
        assign(recording, time="tick:s", output="y:rad")


def with_times(t: np.ndarray) -> Recording:
    return assign(made("u", "y", t=t), output="y:rad")


def test_samples_whose_time_does_not_increase_are_left_out_with_a_warning() -> None:
    t = T.copy()
    t[10] = t[9]  # doubled
    t[50] = 1e6  # wild
    t[70] = np.nan

    assigned = with_times(t)

    expected = np.delete(t, [10, 50, 70])
    assert np.array_equal(assigned["u"].t, expected)
    assert np.array_equal(assigned["y"].t, expected)
    assert finding(assigned.findings, "rows-left-out").severity is Severity.WARNING
    assert finding(assigned.findings, "rows-left-out").rows == (11, 71)


def test_the_first_of_doubled_times_stays() -> None:
    t = np.repeat(T[:50], 2)
    recording = made("u", "y", t=t)

    assigned = assign(recording, output="y:rad")

    assert assigned["y"].values.tolist() == recording["y"].values[::2].tolist()


@pytest.mark.parametrize(
    "t",
    [
        np.concatenate([T, T]),
        np.concatenate([T, T[:12]]),  # a short second run
        np.concatenate([T[:12], T]),
        (np.arange(300.0) * 30) % 4096,  # a counter that wraps
    ],
    ids=["two runs", "a long and a short run", "a short and a long run", "a counter"],
)
def test_several_runs_in_one_file_are_an_error(t: np.ndarray) -> None:
    with pytest.raises(FormatError, match=r"the time goes back .*\. Put each run"):
        with_times(t)


def test_rows_out_of_order_are_to_be_sorted() -> None:
    with pytest.raises(
        FormatError, match=r"the time goes back \d+ times, .*\. Sort the rows by it; or name another"
    ):
        with_times(np.random.default_rng(1).permutation(T))


def test_a_duration_that_goes_back_all_along_may_be_no_time_and_its_longest_step_back_is_told() -> None:
    """Seconds since 1970 plus up to 30 ms by chance: six digits of them are all alike."""
    t = 1.7e9 + 0.03 * np.random.default_rng(2).random(100)
    t[[40, 41]] = 1.7e9 + 0.05, 1.7e9 + 0.0015

    with pytest.raises(FormatError) as caught:
        with_times(t)

    message = str(caught.value)
    assert "the furthest by 48.5\u00a0ms, from 1700000000.05 s to 1700000000.0015 s at sample 42. " in message
    assert "if it is no time but, for example, a computed duration, name another column" in message


def test_a_time_that_begins_again_says_how_far_it_goes_back_and_where() -> None:
    with pytest.raises(
        FormatError, match=r"goes back once, by 1\.98\u00a0s, from 1\.98 s to 0 s at sample 101\. Put each"
    ):
        with_times(np.concatenate([T, T]))


@pytest.mark.parametrize(("differs", "severity"), [(0.0, Severity.INFO), (1.0, Severity.WARNING)])
def test_rows_that_were_written_twice_lose_nothing(differs: float, severity: Severity) -> None:
    """Every tenth row comes again at once, with the same values or with another one."""
    recording = made("u", "y")
    rows = np.sort(np.append(np.arange(100), np.arange(0, 100, 10)))
    again = np.append(False, np.diff(rows) == 0)
    series = tuple(
        replace(each, t=T[rows], values=each.values[rows] + differs * again) for each in recording.series
    )

    assigned = assign(replace(recording, series=series), output="y:rad")

    assert np.array_equal(assigned["y"].t, T)
    assert finding(assigned.findings, "rows-left-out").severity is severity


def test_times_that_are_all_equal_are_an_error() -> None:
    with pytest.raises(FormatError, match="all times are 3 s"):
        with_times(np.full(50, 3.0))


def test_values_that_are_not_finite_are_left_out_of_their_series_alone() -> None:
    recording = made("u", "y")
    recording["u"].values[[4, 5]] = np.nan
    recording["y"].values[::2] = np.inf

    assigned = assign(recording, output="y:rad")

    assert len(assigned["u"].values) == 98
    assert np.array_equal(assigned["y"].t, T[1::2])
    severities = [each.severity for each in assigned.findings if each.code == "rows-left-out"]
    assert severities == [Severity.WARNING, Severity.INFO]


@pytest.mark.parametrize(
    ("lost", "severity"),
    [(slice(14, 17), Severity.INFO), (slice(14, 18), Severity.WARNING), (slice(18, 21), Severity.WARNING)],
    ids=["within a level", "for longer", "around a change"],
)
def test_a_lost_input_that_is_the_same_before_and_after_is_a_remark(lost: slice, severity: Severity) -> None:
    """The input changes at row 20."""
    u = np.where(np.arange(100) < 20, 0.0, 3.0)
    u[lost] = np.nan

    assigned = assign(changed(made("u", "y"), "u", u, T), output="y:rad")

    assert finding(assigned.findings, "rows-left-out").severity is severity


def test_input_and_output_may_have_different_times() -> None:
    recording = changed(made("u", "y"), "y", np.arange(30.0), 0.07 * np.arange(30))

    assigned = assign(recording, output="y:rad")

    assert len(assigned["u"].values) == 100
    assert assigned["y"].values.tolist() == recording["y"].values.tolist()


@pytest.mark.parametrize("values", [np.full(100, np.nan), np.concatenate([[1.0], np.full(99, np.nan)])])
def test_a_channel_without_two_values_is_an_error(values: np.ndarray) -> None:
    with pytest.raises(FormatError, match="at least two are needed"):
        assign(changed(made("u", "y"), "y", values, T), output="y:rad")


def test_a_column_of_another_file_joins_the_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("y.csv").write_text("1.5\n2.5\n3.5\n")
    Path("sub").mkdir()
    Path("sub/x.csv").write_text("0.5\n0.5\n-0.5\n")
    (recording,) = load("y.csv")

    assigned = assign(recording, input="sub/x.csv#1:V", output="1:rad", sample_time=0.1)

    assert (assigned.input, assigned.output) == ("x.column_1", "column_1")
    assert assigned["x.column_1"].values.tolist() == [0.5, 0.5, -0.5]
    assert "SHA-256" in finding(assigned.findings, "column-from-other-file").sentence


def test_a_mapping_reads_back_from_its_text_and_assigns_the_same(tmp_path: Path) -> None:
    mapping = Mapping(
        input='the "u"\n:%', output="y:deg/s", sample_time=0.1 + 0.2, chain="derivative | lowpass 50 rad/s"
    )
    (tmp_path / "m.toml").write_text(mapping.toml(), encoding="utf-8")

    assert Mapping.read(tmp_path / "m.toml") == mapping
    assert Mapping().toml() == ""
    recording = made("u", "y", t=None)
    said = Mapping(output="y:rad", sample_time=0.5)
    assert said.assign_to(recording) == assign(recording, output="y:rad", sample_time=0.5)


def test_what_is_said_later_overrides_a_mapping() -> None:
    mapping = Mapping(time="t:s", input="u", output="y:rad")

    assert mapping.override_with(Mapping(output="y:deg")) == Mapping(time="t:s", input="u", output="y:deg")
    assert mapping.override_with(Mapping(sample_time=0.1)) == Mapping(
        input="u", output="y:rad", sample_time=0.1
    )


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("inptu = 'u'", "did you mean 'input'"),
        ("input = 3", "input is 3; expected a text"),
        ("sample_time = 'soon'", "isn't a number with a unit"),
        ("sample_time = -1", "expected a positive number"),
        ("input = ", "can't be read"),
    ],
)
def test_a_mapping_file_with_a_mistake_is_an_error_that_names_it(text: str, why: str, tmp_path: Path) -> None:
    (tmp_path / "m.toml").write_text(text)

    with pytest.raises(UsageError, match=why):
        Mapping.read(tmp_path / "m.toml")
    with pytest.raises(UsageError, match="can't be read"):
        Mapping.read(tmp_path / "none.toml")


RealData = Callable[[str], Path]


def test_the_teaching_kit_needs_only_the_unit_of_its_output(real_data: RealData) -> None:
    (recording,) = load(real_data("undcmotor/und_DCmotor_prbs_open_exp.csv"))

    assigned = assign(recording, output="y:deg/s")

    assert (assigned.input, assigned["u"].channel.unit) == ("u", "V")
    assert len(assigned["y"].values) == 4093
    assert {each.severity for each in assigned.findings} == {Severity.INFO}


@pytest.mark.parametrize("name", ["DATA_EMPS.mat", "DATA_EMPS_PULSES.mat"])
def test_the_emps_benchmark_needs_input_and_output(name: str, real_data: RealData) -> None:
    (recording,) = load(real_data(f"emps/{name}"))
    assert len(missing(recording)) == 2

    assigned = assign(recording, input="vir:V", output="qm:m")

    assert len(assigned["qm"].values) == 24_841
    assert {each.severity for each in assigned.findings} == {Severity.INFO}


@pytest.mark.parametrize("name", ["gk_pid.csv", "gk_pid_step.csv", "gk_relay.csv", "gk_repetitive.csv"])
def test_a_table_without_time_units_or_names_is_asked_about_and_then_used(
    name: str, real_data: RealData
) -> None:
    (recording,) = load(real_data(f"gkeiel_pot_servo/{name}"))
    asked = missing(recording)
    assert len(asked) == 3
    assert "`sample_time=" in asked[2]

    assigned = assign(recording, input="Channel 4:%", output="2:deg", sample_time=0.002)

    # A potentiometer with steps of 3.5 degrees repeats its value in most rows, and is not stale for that.
    assert codes(assigned.findings) == ["sample-time-given"]


def test_input_and_output_in_two_files_without_time_are_joined(real_data: RealData) -> None:
    (recording,) = load(real_data("generator_sysidentpy/y_cc.csv"))
    assert len(missing(recording)) == 3
    given = {"input": "x_cc.csv#1:V", "output": "1:counts/s"}
    assert len(missing(recording, **given)) == 1

    assigned = assign(recording, **given, sample_time=0.001)  # type: ignore[arg-type]

    assert len(assigned["x_cc.column_1"].values) == len(assigned["column_1"].values) == 500_000


def test_a_pendulum_with_several_voltages_is_asked_about(real_data: RealData) -> None:
    (recording,) = load(real_data("qube1_koopman_closedloop/qube_20230828T150709_610_277_801.csv"))

    asked = missing(recording)

    assert "`control_output`, `plant_input`" in asked[0]
    assert "`output=theta:UNIT`" in asked[1]
    assert assign(recording, input="plant_input:V", output="theta:rad").input == "plant_input"


def test_a_file_without_its_input_says_so(real_data: RealData) -> None:
    (recording,) = load(real_data("qube3_ip_velocity/a00834778_P7_I+P.mat"))

    (asked,) = missing(recording, time="1:s", output="3:rad/s")

    assert "Identification needs an input" in asked


def test_a_table_with_a_time_but_no_names_is_used_by_number(real_data: RealData) -> None:
    (recording,) = load(real_data("hydraulic_valve_motor/MotorRotation.csv"))
    assert len(missing(recording)) == 3

    assigned = assign(recording, time="1:s", input="2:%", output="3:rad/s")

    assert assigned["column_3"].t is not None
    # Written with two decimals: steps are right to the rounding of 305 s as a double.
    assert np.allclose(np.diff(assigned["column_3"].t), 0.02, atol=1e-13)


def test_times_that_are_rounded_ask_for_the_sample_time_and_say_why(tmp_path: Path) -> None:
    rows = "".join(f"{k // 5 / 100:.2f},{k % 2},{k * 0.1:.3f}\n" for k in range(500))
    recording = loaded(tmp_path, "t [s],u [V],y [rad]\n" + rows)

    (asked,) = missing(recording)
    assert "`sample_time=" in asked
    assert (
        "`t` isn't used as the time, despite its name: it stays the same from one row to the next 400 times."
        in asked
    )
    with pytest.raises(FormatError, match=r"of the 500 .* same time .* `sample_time=0\.00[12]"):
        assign(recording, time="t")
    assert len(assign(recording, sample_time=0.002)["y"].values) == 500


def test_a_clock_that_froze_is_no_column_of_steps() -> None:
    with pytest.raises(FormatError, match="have the same time as the one before"):
        with_times(np.minimum(0.01 * np.arange(100), 0.3))


def test_the_step_from_row_to_row_is_no_time_and_says_the_sample_time() -> None:
    """The clock stood still for a second at row 50."""
    steps = np.full(100, 0.025)
    steps[50] = -0.975

    with pytest.raises(FormatError, match=r"99 of the 100 times are 0\.025 s.*`sample_time=0\.025`"):
        with_times(steps)


def test_rows_that_a_logger_repeats_as_they_were_are_left_out_as_before(tmp_path: Path) -> None:
    rows = "".join(f"{k // 3 / 100:.2f},{k // 3 % 2},{k // 3 * 0.1:.3f}\n" for k in range(300))
    recording = assign(loaded(tmp_path, "t [s],u [V],y [rad]\n" + rows), time="t")

    assert len(recording["y"].values) == 100


def test_another_file_that_is_not_there_is_reported_by_the_name_that_was_given(tmp_path: Path) -> None:
    recording = made("u", "y")
    recording = replace(recording, source=replace(recording.source, name=str(tmp_path / "made.csv")))

    with pytest.raises(UsageError, match=r"there is no file f/nowhere\.csv"):
        assign(recording, input="f/nowhere.csv#u:V", output="y:rad")


def test_counts_in_a_turn_stand_in_a_mapping_and_make_rad(tmp_path: Path) -> None:
    """Half a turn of 500 counts, and half a count for the middle of its bin: (250 + 1/2)·2π/500."""
    from servobench.recordings.measurement.measure import measure

    path = tmp_path / "counted.csv"
    path.write_text(
        "t,u,enc\n" + "".join(f"{0.01 * n},{n % 3},{5 * n}\n" for n in range(51)), encoding="utf-8"
    )
    mapping = Mapping(input="u:V", output="enc:counts", counts_per_rev=500)
    file = tmp_path / "map.toml"
    file.write_text(mapping.toml(), encoding="utf-8")

    assert Mapping.read(file) == mapping
    data = measure(Mapping.read(file).assign_to(load(path)[0]))
    assert data.position_unit == "rad"
    # The first rows, whose input may be from before the record, are no part of the data.
    assert data.t_output[-1] == pytest.approx(0.5)
    assert data.y[-1] == pytest.approx(250.5 * 2 * np.pi / 500)


def test_counts_in_a_turn_that_are_no_number_are_reported(tmp_path: Path) -> None:
    file = tmp_path / "map.toml"
    file.write_text('counts_per_rev = "many"\n', encoding="utf-8")
    with pytest.raises(UsageError, match="counts_per_rev is 'many'"):
        Mapping.read(file)


@pytest.mark.parametrize(("time", "by_convention"), [(None, True), ("t", True), ("t:s", False)])
def test_a_unit_of_the_time_that_is_said_is_no_convention_any_more(
    time: str | None, by_convention: bool, tmp_path: Path
) -> None:
    path = tmp_path / "slow.csv"
    path.write_text("t,u,y\n" + "".join(f"{n},{n % 3},{n}\n" for n in range(40)))
    (recording,) = load(path)

    assigned = assign(recording, time=time, input="u:V", output="y:rad")

    assert ("time-recognised" in codes(assigned.findings)) == by_convention
