"""What a column's name and values say of its unit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from servobench.core.channels import Channel
from servobench.core.errors import MissingInformation, UsageError
from servobench.core.finding import Severity
from servobench.recordings.evidence import evidence_of
from servobench.recordings.formats.likely_units import is_duty_name
from servobench.recordings.formats.mapping import Mapping, assign
from servobench.recordings.recording import Recording, Series, Source
from tests.recordings.formats.tables import codes, finding, loaded

T = 0.01 * np.arange(100)
SHAPE = np.where(np.arange(100) % 40 < 20, 1.0, -0.5)
SPEED = np.random.default_rng(1).normal(size=100)


def table(
    name: str, largest: float = 1.0, *, output: str = "speed", y: np.ndarray = SPEED, unit: str | None = None
) -> Recording:
    """An input of that name, which goes up to `largest` and down to half of it, and an output."""
    series = (
        Series(channel=Channel(name=name, unit=unit), values=largest * SHAPE, t=T),
        Series(channel=Channel(name=output, unit=None), values=y, t=T),
    )
    return Recording(name="table", series=series, source=Source(name="table.csv"))


def log(folder: Path, header: str, begin: float = 0.0) -> Recording:
    """A file with these names of times, an input and an output."""
    rows = (f"{begin + 0.02 * k:.2f},{k % 7},{3 * k}\n" for k in range(50))
    return loaded(folder, f"{header}\n" + "".join(rows))


DOUBTS = {"unit-contradicted", "unit-overridden"}


def question(recording: Recording, role: str, **options: str) -> str:
    """The sentence that asks for something about a role."""
    with pytest.raises(MissingInformation) as caught:
        assign(recording, **options)  # type: ignore[arg-type]
    return next(each for each in caught.value.missing if role in each)


@pytest.mark.parametrize("name", ["pwm", "motorPwm", "duty_cycle", "Duty Cycle", "power", "throttle.left"])
def test_a_whole_word_of_a_name_tells_a_duty(name: str) -> None:
    assert is_duty_name(name)


@pytest.mark.parametrize("name", ["pwm_voltage", "power_supply", "pwm_V", "dutyVolts", "powerful", "u"])
def test_a_name_that_also_speaks_of_volts_tells_no_duty(name: str) -> None:
    assert not is_duty_name(name)


@pytest.mark.parametrize(
    ("name", "largest", "suggestion"),
    [
        ("pwm", 200.0, "such as pwm:PWM/255 (raw counts, if 255 is 100 %); give its supply"),
        ("pwm", 80.0, "such as pwm:PWM/255 (raw counts, if 255 is 100 %) or pwm:%; give its supply"),
        ("pwm", 1000.0, "such as pwm:PWM/1023 (raw counts"),
        ("present_pwm", 600.0, "such as present_pwm:PWM/885 (raw counts"),
        ("duty", 0.8, "such as duty:1 (a fraction) or duty:%; give its supply"),
        ("duty", 80.5, "such as duty:%; give its supply"),
        ("command", 4000.0, "such as command:PWM/4095 (raw counts"),
        ("command", 7.5, "such as command:V"),
    ],
)
def test_the_question_for_an_inputs_unit_suggests_what_its_values_can_be(
    name: str, largest: float, suggestion: str
) -> None:
    assert suggestion in question(
        table(name, largest), "the unit of the input", input=name, output="speed:rpm"
    )


def test_an_output_of_whole_numbers_is_asked_whether_it_is_in_counts() -> None:
    counts = table("u", output="encoder", y=np.arange(100) ** 2 % 97.0)

    assert "such as encoder:counts with `counts_per_rev=...`, or encoder:deg" in question(counts, "output")


def test_pulses_may_be_those_since_the_row_before() -> None:
    pulses = table("u", output="Pulses", y=np.arange(100) ** 2 % 97.0)

    assert "(and `chain=accumulate` if each row holds the counts since the row before)" in question(
        pulses, "output"
    )


@pytest.mark.parametrize(
    ("name", "unit", "is_doubted"), [("duty", None, True), ("duty", "V", False), ("u", None, False)]
)
def test_a_duty_read_in_volts_is_doubted_unless_the_file_says_so(
    name: str, unit: str | None, is_doubted: bool
) -> None:
    assigned = assign(table(name, unit=unit), input=f"{name}:V", output="speed:rpm")

    assert ("unit-contradicted" in codes(assigned.findings)) is is_doubted


@pytest.mark.parametrize(("largest", "is_doubted"), [(0.8, True), (1.0, True), (1.5, False), (80.0, False)])
def test_a_duty_that_never_exceeds_one_per_cent_is_doubted(largest: float, is_doubted: bool) -> None:
    assigned = assign(table("load", largest), input="load:%", output="speed:rpm", supply="12 V")

    assert ("unit-contradicted" in codes(assigned.findings)) is is_doubted
    if is_doubted:
        assert "say `input=load:1`" in finding(assigned.findings, "unit-contradicted").sentence


@pytest.mark.parametrize(
    ("output", "chain", "is_doubted"),
    [
        ("erpm", "", True),
        ("motor_eRPM", "none", True),
        ("erpm", "scale 7", False),
        ("rpm", "", False),
        ("power_rpm", "", False),
    ],
)
def test_electrical_revolutions_are_doubted_until_their_factor_is_known(
    output: str, chain: str, is_doubted: bool
) -> None:
    mapping = Mapping(input="u:V", output=f"{output}:rpm", chain=chain)

    evidence = evidence_of(table("u", output=output), mapping)

    assert ("unit-contradicted" in codes(evidence.recording.findings)) is is_doubted


@pytest.mark.parametrize(
    ("output", "is_doubted"),
    [
        ("ticks", True),
        ("delta_counts", True),
        ("encoderPulses", True),
        ("counts_per_s", False),
        ("tick rate", False),
        ("speed", False),
    ],
)
def test_counts_that_are_called_a_speed_are_doubted(output: str, is_doubted: bool) -> None:
    evidence = evidence_of(table("u", output=output), Mapping(input="u:V", output=f"{output}:counts/s"))

    assert ("unit-contradicted" in codes(evidence.recording.findings)) is is_doubted
    if is_doubted:
        doubt = finding(evidence.recording.findings, "unit-contradicted")
        assert f"`output={output}:counts` and `chain=accumulate`, or `chain=scale 1`" in doubt.sentence


@pytest.mark.parametrize(
    ("stated", "says"),
    [
        ("pwm_percent:V", "such as pwm_percent:%, with"),
        ("pwm_percent:PWM/255", "by a factor of 2.55. Say `input=pwm_percent:%`"),
        ("pwm_percent:PWM/100", None),
        ("pwm_percent:%", None),
    ],
)
def test_a_duty_in_per_cent_by_its_name_is_doubted_as_anything_else(stated: str, says: str | None) -> None:
    recording = table("pwm_percent", 20.0, unit="%")

    findings = assign(recording, input=stated, output="speed:rad/s").findings

    sentences = [each.sentence for each in findings if each.code == "unit-contradicted"]
    assert [says in each for each in sentences if says] == [True] * (says is not None)
    assert bool(sentences) is (says is not None)


@pytest.mark.parametrize(
    ("largest", "chain", "is_doubted"),
    [(60.0, "", True), (60.0, "scale 1", False), (600.0, "", False), (60.5, "", False)],
)
def test_whole_counts_a_second_that_are_less_than_a_count_in_each_row_are_doubted(
    largest: float, chain: str, is_doubted: bool
) -> None:
    mapping = Mapping(input="u:V", output="speed:counts/s", chain=chain)

    evidence = evidence_of(table("u", y=largest * SHAPE), mapping)  # 60 counts/s are 0.6 in 0.01 s

    assert ("unit-contradicted" in codes(evidence.recording.findings)) is is_doubted


def test_multiples_of_a_number_are_counts_over_the_time_of_several_rows() -> None:
    """20 counts/s are one in 50 ms, over which a coarse encoder's speed was taken."""
    mapping = Mapping(input="u:V", output="speed:counts/s")

    evidence = evidence_of(table("u", y=20.0 * (np.arange(100) % 5 - 1)), mapping)

    assert "unit-contradicted" not in codes(evidence.recording.findings)


@pytest.mark.parametrize(
    ("output", "says", "factor"),
    [
        ("RPM:rad/s", "its name says rpm", "9.549"),
        ("angle_deg:rad", "its name says deg", "57.3"),
        ("speed_rpm:rpm", "", ""),
        ("speed_rps:rev/s", "", ""),  # the same under another name
    ],
)
def test_an_output_in_another_unit_than_its_name_ends_in_is_doubted(
    output: str, says: str, factor: str, tmp_path: Path
) -> None:
    recording = log(tmp_path, f"t,u,{output.partition(':')[0]}")

    doubts = [each for each in assign(recording, input="u:V", output=output).findings if each.code in DOUBTS]

    assert [each.severity for each in doubts] == ([Severity.WARNING] if says else [])
    assert all(says in each.sentence and f"by a factor of {factor}" in each.sentence for each in doubts)


def test_a_unit_written_beside_the_name_counts_more_than_the_end_of_the_name(tmp_path: Path) -> None:
    recording = log(tmp_path, "t,u,RPM [rad/s]")

    assert not DOUBTS & set(codes(assign(recording, output="RPM:rad/s").findings))
    overridden = finding(assign(recording, output="RPM:rpm").findings, "unit-overridden")
    assert overridden.severity is Severity.INFO


def test_a_unit_of_something_else_than_the_name_ends_in_is_no_matter_of_a_factor(tmp_path: Path) -> None:
    recording = log(tmp_path, "t,u,encoder_counts")

    assert (
        finding(assign(recording, output="encoder_counts:deg").findings, "unit-overridden").severity
        is Severity.INFO
    )


def test_an_input_in_another_unit_than_its_name_ends_in_is_doubted(tmp_path: Path) -> None:
    recording = log(tmp_path, "t,u_mV,y [rad]")

    doubt = finding(assign(recording, input="u_mV:V").findings, "unit-contradicted")
    assert "by a factor of 1000. Say `input=u_mV:mV`, or rename the column" in doubt.sentence


@pytest.mark.parametrize(("time", "is_doubted"), [("t_ms:s", True), ("t_ms:ms", False), ("t_ms", False)])
def test_a_time_in_another_unit_than_its_name_ends_in_is_doubted(
    time: str, is_doubted: bool, tmp_path: Path
) -> None:
    recording = log(tmp_path, "t_ms,u,y [rad]")

    assigned = assign(recording, time=time)

    assert ("unit-contradicted" in codes(assigned.findings)) is is_doubted


def test_a_time_whose_values_are_dates_in_the_unit_that_was_said_is_not_doubted(tmp_path: Path) -> None:
    recording = log(tmp_path, "t_ms,u,y [rad]", begin=1_700_000_000.0)

    assert not DOUBTS & set(codes(assign(recording, time="t_ms:ms").findings))
    assert "unit-contradicted" not in codes(assign(recording, time="t_ms:s").findings)


def test_a_time_as_the_output_may_be_metres_per_second() -> None:
    with pytest.raises(UsageError, match=r"If ms is m/s here, say `output=v_ms:m/s`"):
        assign(table("u", output="v_ms"), input="u:V", output="v_ms:ms")


def test_servo_pulses_as_the_input_are_to_be_converted() -> None:
    pulses = table("pwm_us", unit="us")
    series = (Series(channel=pulses.series[0].channel, values=1500 + 400 * SHAPE, t=T), pulses.series[1])
    servo = Recording(name="servo", series=series, source=Source(name="servo.csv"))

    assert "`input=pwm_us:UNIT`. These look like servo pulses" in question(
        servo, "the input", output="speed:rpm"
    )
    with pytest.raises(
        UsageError, match=r"write \(pulse - 1500\)/500 into the file, and say `input=pwm_us:1`"
    ):
        assign(servo, input="pwm_us", output="speed:rpm")


def test_any_other_time_as_the_input_is_asked_what_a_whole_period_is() -> None:
    with pytest.raises(UsageError, match=r"not a time\. If it is a pulse width, say what 100 % is"):
        assign(table("on_us", 30.0, unit="us"), input="on_us", output="speed:rpm")


@pytest.mark.parametrize("name", ["enc", "count", "TIM3_CNT", "pulses"])
def test_usual_names_of_an_encoder_are_recognised(name: str) -> None:
    assigned = assign(table("u", output=name, y=np.arange(100) ** 2 % 97.0), counts_per_rev=2048)

    assert assigned.output == name


def test_a_count_of_the_rows_is_no_encoder() -> None:
    assert "which column is the output" in question(table("u", output="count", y=np.arange(100.0)), "output")
