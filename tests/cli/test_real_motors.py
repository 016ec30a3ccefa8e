"""The required answers to the recordings of real motors that were tried last, by the command line as a user types it.

The figures that intervals are held to stand in the folders' own README files: published ones, and those of independent fits by
least squares.
"""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest

from tests.cli.conftest import Command
from tests.cli.test_real_recordings import ASKS, REFUSED, RealData, codes, holds

BY_DUTY = ("--time", "2:s", "--input", "1:%", "--output", "4:deg")
BY_LEVEL = ("--time", "t:s", "--input", "duty:%", "--output", "angle:deg")
BY_STEP = ("--time", "time:s", "--input", "voltage:V", "--output", "theta1:rad")
BY_CURRENT = ("--time", "1:s", "--input", "2:A", "--output", "4:rad")
BY_FLAG = ("--time", "Tempo:s", "--input", "Degrau:1", "--output", "Velocidade:rpm")
BY_SPEED = ("--input", "data.input signal:V", "--output", "data.Motor Angular Velocity:rad/s")


@pytest.mark.parametrize("duty", ["100", "60", "-80", "-40"])
def test_a_single_duty_tells_speed_and_time_constant_and_no_gain(
    duty: str, servobench: Command, real_data: RealData
) -> None:
    result = servobench("identify", real_data(f"ev3_duty/data{duty}.csv"), *BY_DUTY, "--json").result

    found = result["parameters"]
    assert found["gain"]["state"] == "combination"
    assert holds(found["time_constant"], 0.106)
    assert found["delay"]["interval"][0] < 0.013
    # The joint fit of all levels: gain 6.70 (deg/s)/%, dead zone 6.8 %. It holds within a few percent at each.
    level = float(duty)
    speed = math.radians(6.70 * (level - math.copysign(6.8, level)))
    assert result["combinations"]["speed_at_level"]["value"] == pytest.approx(speed, rel=0.06)


def test_duties_together_tell_gain_and_dead_zone(servobench: Command, real_data: RealData) -> None:
    paths = [real_data(f"ev3_duty/data{duty}.csv") for duty in ("100", "60", "-80", "-40")]

    result = servobench("identify", *paths, *BY_DUTY, "--json").result

    found = result["parameters"]
    assert holds(found["gain"], math.radians(6.70))
    assert holds(found["time_constant"], 0.106)
    assert holds(found["coulomb_voltage"], 6.8)


def test_a_motor_that_is_stuck_is_named(servobench: Command, real_data: RealData) -> None:
    ended = servobench("identify", real_data("ev3_duty/data20.csv"), *BY_DUTY)

    assert ended.status == REFUSED
    assert "data20: the output stays at" in ended.out


def with_its_level(path: Path, folder: Path) -> Path:
    """A copy of a recording with the duty that stands in its name as a column."""
    duty = re.search(r"_(\d+)pwr", path.name)
    assert duty is not None
    rows = [line.split() for line in path.read_text(encoding="utf-8").splitlines() if line.strip()]
    made = folder / f"{duty[1]}.csv"
    made.write_text("t,duty,angle\n" + "".join(f"{t},{duty[1]},{angle}\n" for t, angle in rows), "utf-8")
    return made


def of_level(level: int) -> str:
    return f"ev3_large/dataLargeMotor_black_{level}pwr_1000sec.txt"


def test_an_input_that_stands_in_the_file_s_name_only_is_asked_for(
    servobench: Command, real_data: RealData
) -> None:
    ended = servobench("identify", real_data(of_level(50)))

    assert ended.status == ASKS
    assert "which column is the input" in ended.err


@pytest.mark.parametrize("level", [20, 50, 80, 100])
def test_a_level_alone_allows_for_what_the_model_misses(
    level: int, servobench: Command, real_data: RealData, tmp_path: Path
) -> None:
    path = with_its_level(real_data(of_level(level)), tmp_path)

    result = servobench("identify", path, *BY_LEVEL, "--json").result

    assert result["parameters"]["gain"]["state"] == "combination"
    # File by file the time constant rises from 0.044 to 0.065 s with the level: all of them are this motor's.
    low, high = result["parameters"]["time_constant"]["interval"]
    assert low < 0.050 < high


def test_levels_together_tell_the_gain(servobench: Command, real_data: RealData, tmp_path: Path) -> None:
    paths = [with_its_level(real_data(of_level(level)), tmp_path) for level in (20, 40, 60, 80, 100)]

    result = servobench("identify", *paths, *BY_LEVEL, "--json").result

    assert holds(result["parameters"]["gain"], math.radians(9.385))
    low, high = result["parameters"]["time_constant"]["interval"]
    assert low < 0.054
    assert high > 0.047


def test_stairs_through_a_bridge_hold_the_gains_of_both_halves(
    servobench: Command, real_data: RealData
) -> None:
    columns = ("--time", "time:s", "--input", "voltage:V", "--output", "rpm:rpm")

    result = servobench("identify", real_data("l298_stairs/run_minimal.csv"), *columns, "--json").result

    gain = result["parameters"]["gain"]
    for rpm in (33.7, 34.9, 35.2):
        assert holds(gain, rpm * 2 * math.pi / 60)
    assert holds(result["parameters"]["time_constant"], 0.365)


def in_seconds(path: Path, folder: Path) -> Path:
    """A copy of a log whose ticks of 8 kHz are times in s, as nobody could guess that they are."""
    made = folder / f"{path.stem}.csv"
    rows = [re.split(r"[;,\s]+", line) for line in path.read_text("utf-8").splitlines() if line[:1].isdigit()]
    made.write_text(
        "t,u,theta\n" + "".join(f"{float(r[0]) / 8000},{r[1]},{r[2]}\n" for r in rows), encoding="utf-8"
    )
    return made


BY_TICKS = ("--time", "t:s", "--input", "u:V", "--output", "theta:rev")


@pytest.mark.parametrize("name", ["step1", "step2"])
def test_a_step_that_is_over_within_a_sample_bounds_the_time_constant(
    name: str, servobench: Command, real_data: RealData, tmp_path: Path
) -> None:
    path = in_seconds(real_data(f"odrive_characterization/{name}.csv"), tmp_path)

    result = servobench("identify", path, *BY_TICKS, "--json").result

    tau = result["parameters"]["time_constant"]
    assert tau["state"] == "bounded"
    assert 0.003 < tau["interval"][1] < 0.02
    # Published 18.0 rev/s for each volt; the step is 0.25 V.
    speed = result["combinations"]["speed_at_level"]["value"]
    assert speed == pytest.approx(0.25 * 18.0 * 2 * math.pi, rel=0.02)


@pytest.mark.parametrize("name", ["chirp1", "chirp2", "noise1", "impulse1"])
def test_what_can_hardly_support_a_model_is_distrusted(
    name: str, servobench: Command, real_data: RealData, tmp_path: Path
) -> None:
    path = in_seconds(real_data(f"odrive_characterization/{name}.csv"), tmp_path)

    result = servobench("identify", path, *BY_TICKS, "--json").result

    assert result["verdict"] in ("doubtful", "refused")
    assert result["parameters"]["gain"]["state"] == "unknown"


@pytest.mark.parametrize("side", ["left", "right"])
def test_four_tests_of_a_drive_hold_the_published_gains(
    side: str, servobench: Command, real_data: RealData
) -> None:
    path = real_data("swerve_sysid/12_12_Swerve.json")
    columns = ("--input", f"{side}_voltage", "--output", f"{side}_position")

    result = servobench("identify", path, *columns, "--json").result

    found = result["parameters"]
    assert holds(found["gain"], 9.23)
    assert holds(found["coulomb_voltage"], 0.24387)
    assert found["time_constant"]["interval"][1] > 0.128


@pytest.mark.parametrize("test", ["slow-forward", "slow-backward", "fast-forward", "fast-backward"])
def test_one_test_of_a_drive_alone_does_not_mislead(
    test: str, servobench: Command, real_data: RealData
) -> None:
    path = real_data("swerve_sysid/12_12_Swerve.json")
    columns = ("--input", "left_voltage", "--output", "left_position", "--recording", test)

    result = servobench("identify", path, *columns, "--json").result

    true = {"gain": 9.23, "time_constant": 0.128, "coulomb_voltage": 0.24387}
    for name, value in true.items():
        one = result["parameters"].get(name)
        if one is not None and one["state"] == "known":
            assert one["interval"][0] <= value <= one["interval"][1], name
    if result["parameters"]["delay"]["state"] == "known":
        assert result["parameters"]["delay"]["interval"][0] < 0.05


@pytest.mark.parametrize("name", ["data2_1v", "data3_1v"])
def test_a_step_of_one_volt_tells_no_gain(name: str, servobench: Command, real_data: RealData) -> None:
    result = servobench("identify", real_data(f"qube3_steps/{name}.csv"), *BY_STEP, "--json").result

    assert result["parameters"]["gain"]["state"] == "combination"
    # Both files are at about 8.5 to 9.1 rad/s as they end; the time constant is about 1.1 s.
    low, high = result["combinations"]["speed_at_level"]["interval"]
    assert low < 9.7
    assert high > 8.5
    assert holds(result["parameters"]["time_constant"], 1.1)


def test_the_running_current_says_that_the_encoder_s_scale_is_off(
    servobench: Command, real_data: RealData
) -> None:
    path = real_data("qube3_steps/data3_1v.csv")

    ended = servobench(
        "identify", path, *BY_STEP, "--current", "current:A", "--nominal", "qube_servo_3", "--json"
    )

    (factor,) = [each for each in ended.result["findings"] if each["code"] == "factor-off"]
    assert "close to 2, the factor of " in factor["sentence"]
    assert ended.result["verdict"] == "doubtful"


@pytest.mark.parametrize(
    ("path", "columns"),
    [("spin_up_event/motor_spin_up_3V_time.csv", ("--time", "Time:s", "--output", "Angle:deg"))],
)
def test_a_spin_up_without_an_input_asks_for_it(
    path: str, columns: tuple[str, ...], servobench: Command, real_data: RealData
) -> None:
    ended = servobench("identify", real_data(path), *columns)

    assert ended.status == ASKS
    assert "which column is the input" in ended.err


@pytest.mark.parametrize("side", ["L", "R"])
def test_a_wheel_below_a_count_a_row_is_not_called_blocked(
    side: str, servobench: Command, real_data: RealData
) -> None:
    columns = ("--time", "t:ms", "--input", f"pwm{side}:1", "--output", f"vel{side}:rad/s")

    ended = servobench("identify", real_data("slow_ticks/motor-direito.csv"), *columns, "--all-findings")

    said = ended.out + ended.err
    assert "trusted:" not in said
    if side == "R":  # the one that turns
        assert "blocked" not in said


def test_a_flag_behind_an_average_that_is_reported_has_no_long_delay(
    servobench: Command, real_data: RealData
) -> None:
    path = real_data("waam_average/Feb-09-2022--14-42-41.csv")

    plain = servobench("identify", path, *BY_FLAG, "--json").result
    told = servobench("identify", path, *BY_FLAG, "--chain", "average 0.128 s", "--json").result

    assert "chain-unknown" in codes(plain)
    # Half the average's 128 ms looks like a delay, unless one knows; no interval leaves out what is so.
    assert plain["parameters"]["delay"]["interval"][1] > 0.050
    assert told["verdict"] == "trusted"
    # With it the delay is 0 to 12 ms and the time constant 0.07 to 0.15 s.
    assert told["parameters"]["delay"]["value"] < 0.020
    low, high = told["parameters"]["time_constant"]["interval"]
    assert low < 0.15
    assert high > 0.07


@pytest.mark.parametrize(("name", "level"), [("vise-constant-0.5a", 0.5), ("vise-constant-1a", 1.0)])
def test_a_wheel_that_gets_ever_faster_tells_its_acceleration_only(
    name: str, level: float, servobench: Command, real_data: RealData
) -> None:
    result = servobench("identify", real_data(f"reaction_wheel/{name}.csv"), *BY_CURRENT, "--json").result

    found = result["parameters"]
    assert [found[each]["state"] for each in ("gain", "time_constant")] == ["combination"] * 2
    # By both files: 29.6 rad/s² for each ampere beyond 0.08 A of friction.
    assert holds(result["combinations"]["acceleration_at_level"], 29.6 * (level - 0.08))


def test_two_levels_of_current_tell_gain_over_time_constant(servobench: Command, real_data: RealData) -> None:
    paths = [real_data(f"reaction_wheel/vise-constant-{level}a.csv") for level in ("0.5", "1")]

    result = servobench("identify", *paths, *BY_CURRENT, "--json").result

    found = result["parameters"]
    assert [found[each]["state"] for each in ("gain", "time_constant")] == ["combination"] * 2
    assert holds(result["combinations"]["acceleration"], 29.6)


def test_a_file_without_a_test_has_nothing_to_identify(servobench: Command, real_data: RealData) -> None:
    ended = servobench("identify", real_data("refuse/frc2635_empty_sysid.json"))

    assert ended.status == ASKS
    assert "has no test with rows" in ended.err


def test_a_supply_at_half_the_voltage_is_named(servobench: Command, real_data: RealData) -> None:
    paths = [real_data(f"refuse/minifi_{name}-1.mat") for name in ("step", "step6VPSU")]

    ended = servobench("identify", *paths, *BY_SPEED)

    # 8.9 over 19.5 (rad/s)/V
    assert "minifi_step6VPSU-1 moves as if its input were 0.46 times the recorded one" in " ".join(
        ended.out.split()
    )
    assert "trusted:" not in ended.out


def test_a_command_beyond_full_scale_is_found_in_a_ramp(servobench: Command, real_data: RealData) -> None:
    columns = ("--input", "data.Ramp:counts", "--output", "data.Angular_Velocity:rad/s")

    ended = servobench("identify", real_data("fra233_pwm/Ramp_25Percent_Rec1.mat"), *columns)

    limit = re.search(r"Inputs beyond about (\S+) counts have no further effect", " ".join(ended.out.split()))
    assert limit is not None
    # Full scale is 65,535 counts; friction in the lowest part of the ramp moves what is found by a tenth.
    assert float(limit[1]) == pytest.approx(65535, rel=0.15)


def test_a_staircase_that_visibly_drives_the_motor_is_not_called_chance(
    servobench: Command, real_data: RealData
) -> None:
    """Four fifths of the output follow it; the first two levels, by themselves, tell little."""
    columns = ("--time", "column_1:s", "--input", "column_2:V", "--output", "column_3:rad/s")

    ended = servobench("identify", real_data("hydraulic_valve_motor/MotorRotation.csv"), *columns, "--json")

    assert "fit-by-chance" not in {each["code"] for each in ended.result["findings"]}
