"""An input that stands in the lab book or in the file's name, and a sample time that a column of one value gives."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import servobench as sb
from servobench.core.errors import MissingInformation, UsageError
from servobench.core.finding import Severity
from servobench.recordings.formats.base import load
from servobench.recordings.formats.mapping import Mapping, assign
from servobench.recordings.recording import Recording, Source
from tests.recordings.formats.tables import codes, finding, loaded

ROWS = "".join(f"{0.004 * k:.3f}\t{3 * k * k}\n" for k in range(60))


def log(folder: Path, name: str = "motor_50pwr_10sec.txt") -> Recording:
    path = folder / name
    path.write_text(ROWS)
    return load(path)[0]


COLUMNS = {"time": "1:s", "output": "2:deg"}


@pytest.mark.parametrize(
    ("text", "value", "unit"),
    [("50:%", 50.0, "%"), ("7 V", 7.0, "V"), ("-1,5:V", -1.5, "V"), ("200:PWM/255", 200 / 255 * 100, "%")],
)
def test_a_stated_input_is_a_channel_of_one_value(text: str, value: float, unit: str, tmp_path: Path) -> None:
    assigned = assign(log(tmp_path), input_value=text, **COLUMNS)

    series = assigned[str(assigned.input)]
    assert series.values == pytest.approx(np.full(60, value))
    assert series.channel.unit == unit
    assert series.t is not None
    assert np.array_equal(series.t, assigned[str(assigned.output)].t)
    assert "throughout, as stated" in finding(assigned.findings, "input-stated").sentence


@pytest.mark.parametrize(
    ("name", "pattern", "value"),
    [
        ("motor_50pwr_10sec.txt", "{level}pwr:%", 50.0),
        ("data-40.csv", "data{level}:%", -40.0),
        ("data-40.csv", "data-{level}:%", 40.0),
        ("step 1.5V run 3.csv", "{level}V:V", 1.5),
        ("step_1,5V.csv", "step_{level}V:V", 1.5),
    ],
)
def test_an_input_is_what_the_files_name_has(name: str, pattern: str, value: float, tmp_path: Path) -> None:
    assigned = assign(log(tmp_path, name), input=pattern, **COLUMNS)

    assert set(assigned[str(assigned.input)].values) == {value}
    assert name in finding(assigned.findings, "input-stated").sentence


@pytest.mark.parametrize(
    ("said", "why"),
    [
        ({"input_value": "50"}, "`input_value=50`: expected a number with a unit"),
        ({"input_value": "fifty:%"}, "expected a number with a unit"),
        ({"input_value": "5:furlong"}, "expected a number with a unit"),
        ({"input_value": "1e999:V"}, "too large"),
        ({"input": "{level}pwr"}, "a unit after the pattern"),
        ({"input": "{level}{level}:%"}, r"expected \{level\} once"),
        ({"input": "{level}volt:V"}, "has none"),
        ({"input": "{level}:%"}, "several: 10, 50"),
        ({"input": "1:V", "input_value": "5:V"}, "give one of them"),
    ],
)
def test_a_value_that_can_t_be_is_reported(said: dict[str, str], why: str, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=why):
        assign(log(tmp_path, "motor_50 10.txt"), **{"time": "1:s", "output": "2:deg", **said})


def test_a_column_that_is_called_like_a_pattern_stays_a_column(tmp_path: Path) -> None:
    path = tmp_path / "odd.csv"
    path.write_text("t,{level},y\n" + "".join(f"{0.1 * k},{k % 3},{k}\n" for k in range(30)))

    assigned = assign(load(path)[0], input="{level}:V", output="y:rad")

    assert assigned.input == "{level}"


def test_a_mapping_keeps_either_and_the_nearer_one_holds(tmp_path: Path) -> None:
    mapping = Mapping(input="{level}pwr:%", output="2:deg", time="1:s")
    file = tmp_path / "mapping.toml"
    file.write_text(mapping.toml())

    assert Mapping.read(file) == mapping
    assert mapping.override_with(Mapping(input_value="5:V")).input is None
    assert Mapping(input_value="5:V").override_with(Mapping(input="u:V")).input_value is None
    assigned = mapping.override_with(Mapping(input_value="5:V")).assign_to(log(tmp_path))
    assert set(assigned[str(assigned.input)].values) == {5.0}


def test_python_takes_one_value_for_all_or_one_for_each(tmp_path: Path) -> None:
    paths = []
    for level in (20, 50, 80):
        u = np.full(500, float(level))
        t = 0.004 * np.arange(500)
        speed = 9.4 * (u - 2.0)
        angle = speed * (t - 0.05 * (1 - np.exp(-t / 0.05)))
        paths.append(tmp_path / f"motor_{level}pwr.txt")
        paths[-1].write_text("".join(f"{a:.3f}\t{int(b)}\n" for a, b in zip(t, angle, strict=True)))

    each = sb.identify(paths, input_value=["20:%", "50:%", "80:%"], starts_at_rest=True, **COLUMNS)
    named = sb.identify(paths, input="{level}pwr:%", starts_at_rest=True, **COLUMNS)

    low, high = each["gain"].interval
    assert low <= np.radians(9.4) <= high
    assert named["gain"].interval == each["gain"].interval
    with pytest.raises(UsageError, match="input_value has 2 values, and data 3"):
        sb.identify(paths, input_value=["20:%", "50:%"], **COLUMNS)
    with pytest.raises(UsageError, match="both input and input_value"):
        sb.identify(paths, input_value="20:%", input="1:V", **COLUMNS)
    with pytest.raises(UsageError, match="input_value is 20"):
        sb.identify(paths, input_value=20, **COLUMNS)  # type: ignore[arg-type]


def table(folder: Path, heading: str, first: str, rest: str = "") -> Recording:
    path = folder / "rate.csv"
    rows = [f"{k % 7},{k * k},{first if k == 0 else rest}" for k in range(40)]
    path.write_text("\n".join([f"u,y,{heading}", *rows]) + "\n")
    return load(path)[0]


@pytest.mark.parametrize(
    ("heading", "first", "rest", "step"),
    [("Ts", "0.004", "", 0.004), ("fs", "250", "", 0.004), ("dt [ms]", "4", "4", 0.004), ("fs [kHz]", "0.25", "", 0.004)],
)  # fmt: skip
def test_a_rate_in_the_first_row_gives_the_times(
    heading: str, first: str, rest: str, step: float, tmp_path: Path
) -> None:
    assigned = assign(table(tmp_path, heading, first, rest), input="u:V", output="y:deg")

    t = assigned["y"].t
    assert t is not None
    assert t == pytest.approx(step * np.arange(40))
    assert "0.004 s apart, as" in finding(assigned.findings, "sample-time-in-file").sentence
    other = assign(table(tmp_path, heading, first, rest), input="u:V", output="y:deg", sample_time=0.1)
    assert other["y"].t == pytest.approx(0.1 * np.arange(40))
    assert "sample-time-in-file" not in codes(other.findings)
    assert finding(other.findings, "sample-time-contradicts").severity is Severity.WARNING
    same = assign(table(tmp_path, heading, first, rest), input="u:V", output="y:deg", sample_time=step)
    assert "sample-time-contradicts" not in codes(same.findings)


@pytest.mark.parametrize(
    ("heading", "first", "rest"),
    [
        ("Ts", "0.004", "0.005"),
        ("fs", "-3", ""),
        ("fs", "1e12", ""),
        ("rate", "250", ""),
        ("Ts [V]", "4", ""),
    ],
)
def test_what_is_no_sample_time_is_asked_for(heading: str, first: str, rest: str, tmp_path: Path) -> None:
    with pytest.raises(MissingInformation, match="the times"):
        assign(table(tmp_path, heading, first, rest), input="u:V", output="y:deg")


@pytest.mark.parametrize(("given", "told"), [(0.008, True), (0.002, True), (0.004, False), (0.00404, False)])
def test_a_sample_time_that_the_files_times_contradict_is_a_warning(
    given: float, told: bool, tmp_path: Path
) -> None:
    path = tmp_path / "log.txt"
    path.write_text("t\tangle\n" + ROWS)

    assigned = assign(load(path)[0], input_value="50:%", output="angle:deg", sample_time=given)

    assert ("sample-time-contradicts" in codes(assigned.findings)) is told
    if told:
        found = finding(assigned.findings, "sample-time-contradicts")
        assert found.severity is Severity.WARNING
        assert "0.004 s apart" in found.sentence
        assert f"is {given:g} s" in found.sentence


@pytest.mark.parametrize(("header", "is_contradicted"), [("t", False), ("t [s]", True)])
def test_numbers_of_rows_contradict_no_sample_time(
    header: str, is_contradicted: bool, tmp_path: Path
) -> None:
    recording = loaded(
        tmp_path, f"{header},u [V],y [deg]\n" + "".join(f"{k},{k % 7},{k}\n" for k in range(744, 800))
    )

    assigned = assign(recording, sample_time=0.01)

    assert ("sample-time-contradicts" in codes(assigned.findings)) is is_contradicted


def test_arrays_with_times_and_another_sample_time_are_warned_of() -> None:
    t = 0.002 * np.arange(2000)
    u = np.where(t % 2 < 1, 3.0, 1.0)
    y = np.cumsum(u) * 0.002

    result = sb.identify(t=t, u=u, y=y, input_unit="V", output_unit="rad", sample_time=0.01)

    assert "sample-time-contradicts" in [each.code for each in result.findings]
    assert result.verdict != "trusted"


def test_several_motors_side_by_side_are_told_apart_by_a_part_of_the_names(tmp_path: Path) -> None:
    path = tmp_path / "two.csv"
    names = "t,voltage left,voltage right,speed left,speed right"
    path.write_text(names + "\n" + "".join(f"{0.1 * k},1,2,{k},{2 * k}\n" for k in range(30)))
    recording = load(path)[0]

    assigned = assign(recording, input="right:V", output="right:rpm")

    assert (assigned.input, assigned.output) == ("voltage right", "speed right")
    with_units = replace(recording, source=Source(name="two.csv"))
    assert "`left` is taken to be `voltage left`" in " ".join(
        each.sentence for each in assign(with_units, input="left:V", output="left:rpm").findings
    )


def test_the_question_names_one_of_several_motors(tmp_path: Path) -> None:
    path = tmp_path / "two.csv"
    names = "t,left_u [V],right_u [V],left_y [deg],right_y [deg]\n"
    path.write_text(names + "".join(f"{0.1 * k},1,2,{k},{k}\n" for k in range(30)))

    with pytest.raises(MissingInformation) as error:
        assign(load(path)[0])
    assert "If there are several motors, choose one: `input=left`" in str(error.value)
    assert "If there are several motors, choose one: `output=left`" in str(error.value)
    assert assign(load(path)[0], input="left", output="left").output == "left_y"
