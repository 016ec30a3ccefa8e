"""Robot code: the constants by a second calculation, and the snippets by the compilers of their languages."""

import json
import math
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from servobench.core.errors import NotIdentifiable, UsageError
from servobench.export.base import TARGETS, Wishes, export
from servobench.export.robot import TARGETS_OF_ROBOTS, next_tests_of, robot_constants
from servobench.export.summary import ResultSummary
from tests.export.conftest import COULOMB, DELAY, GAIN, TAU, document

LANGUAGES = {"java": "DriveConstants.java", "cpp": "drive_constants.h", "python": "drive_constants.py"}
ROW = re.compile(r"\b(k[A-Z]\w*) = ([-+0-9.e]+)")


def with_parameters(**added: tuple[float, float, str]) -> ResultSummary:
    """The motor with parameters more, each as (value, sd, unit), that correlate with nothing."""
    made = document()
    old = np.array(made["covariance"]["matrix"])
    for name, (value, sd, unit) in added.items():
        ends = [value - 1.96 * sd, value + 1.96 * sd]
        made["parameters"][name] = {"value": value, "sd": sd, "interval": ends, "level": 0.95, "unit": unit}
    matrix = np.diag([*np.diag(old), *(sd**2 for _, sd, _ in added.values())])
    matrix[: len(old), : len(old)] = old
    made["covariance"] = {"parameters": list(made["parameters"]), "matrix": matrix.tolist()}
    return ResultSummary.from_document(made, "the result")


def recorded_in(name: str, factor: float) -> ResultSummary:
    """The motor from a file whose user thinks in a unit, of which `factor` are a radian."""
    record = {"user_unit": {"name": name, "factor": factor}}
    return ResultSummary.from_document(document(records=[record, record]), "the result")


def written(answer: ResultSummary, target: str, folder: Path, wishes: Wishes | None = None) -> Path:
    (file,) = export(answer, target, folder / LANGUAGES[target], wishes)
    return file


def numbers(text: str) -> dict[str, float]:
    return {name: float(value) for name, value in ROW.findall(text)}


@pytest.mark.parametrize("target", LANGUAGES)
def test_each_constant_is_in_the_code_with_its_interval_and_unit(
    answer: ResultSummary, target: str, tmp_path: Path
) -> None:
    text = written(answer, target, tmp_path, Wishes(unit="rev")).read_text(encoding="ascii")

    found = numbers(text)
    # kV = 1/K and kA = τ/K by hand, in revolutions; the code has two digits of the interval, 2e-5 of the value.
    assert found["kS"] == pytest.approx(COULOMB, rel=1e-3)
    assert found["kV"] == pytest.approx(2 * math.pi / GAIN, rel=1e-4)
    assert found["kA"] == pytest.approx(2 * math.pi * TAU / GAIN, rel=1e-3)
    for name, unit in (("kS", "V"), ("kV", "V s/rev"), ("kA", "V s^2/rev")):
        ends = re.search(rf"{name} = \S+ +(?://|#) {re.escape(unit)}, 95 %: (\S+) to (\S+)\n", text)
        assert ends is not None, name
        assert float(ends[1]) <= found[name] <= float(ends[2])
    assert "verdict: trusted" in text


def test_a_compiler_of_java_takes_the_class(answer: ResultSummary, tmp_path: Path) -> None:
    if shutil.which("javac") is None or shutil.which("java") is None:
        pytest.skip("no compiler of Java here")
    file = written(answer, "java", tmp_path)
    main = (
        "class Main { public static void main(String[] a) { "
        "System.out.println(DriveConstants.kV + DriveConstants.kA); } }"
    )
    (tmp_path / "Main.java").write_text(main)

    javac = ["javac", "-encoding", "ASCII", "-Werror", "-Xlint:all", str(file), "Main.java"]
    subprocess.run(javac, cwd=tmp_path, check=True, timeout=120)
    said = subprocess.run(
        ["java", "-cp", ".", "Main"], cwd=tmp_path, capture_output=True, text=True, timeout=120
    )

    found = numbers(file.read_text())
    assert float(said.stdout) == pytest.approx(found["kV"] + found["kA"], rel=1e-12)


def test_a_compiler_of_cpp_takes_the_header(answer: ResultSummary, tmp_path: Path) -> None:
    compiler = shutil.which("c++") or shutil.which("g++")
    if compiler is None:
        pytest.skip("no compiler of C++ here")
    file = written(answer, "cpp", tmp_path)
    main = (
        '#include "drive_constants.h"\n#include <cstdio>\n'
        'int main() { std::printf("%.17g", drive_constants::kV + drive_constants::kA); }'
    )
    (tmp_path / "main.cpp").write_text(main)

    command = [compiler, "-std=c++17", "-Wall", "-Wextra", "-Werror", "main.cpp", "-o", "main"]
    subprocess.run(command, cwd=tmp_path, check=True, timeout=120)
    said = subprocess.run([str(tmp_path / "main")], capture_output=True, text=True, timeout=60)

    found = numbers(file.read_text())
    assert float(said.stdout) == pytest.approx(found["kV"] + found["kA"], rel=1e-12)


def test_python_runs_the_module(answer: ResultSummary, tmp_path: Path) -> None:
    text = written(answer, "python", tmp_path).read_text()

    names: dict[str, Any] = {}
    exec(compile(text, "drive_constants.py", "exec"), names)

    assert {name: names[name] for name in numbers(text)} == numbers(text)


def test_the_unit_is_the_files_where_none_is_asked_for() -> None:
    # 0.3 m a turn: K in m/(s·V) is K·0.3/2π, so kV is 2π/(0.3 K).
    wheel = recorded_in("m", 0.3 / (2 * math.pi))

    assert robot_constants(wheel, "java", Wishes()).unit == "m"
    kv = robot_constants(wheel, "java", Wishes()).feedforward["kV"].value
    assert kv == pytest.approx(2 * math.pi / (0.3 * GAIN))
    in_feet = robot_constants(wheel, "java", Wishes(unit="ft")).feedforward["kV"].value
    assert in_feet == pytest.approx(0.3048 * kv)
    turns = robot_constants(wheel, "java", Wishes(unit="rev")).feedforward["kV"].value
    assert turns == pytest.approx(2 * math.pi / GAIN)
    assert robot_constants(recorded_in("rev", 0.5 / math.pi), "java", Wishes()).unit == "rev"


def test_a_wheel_takes_the_place_of_what_the_file_says() -> None:
    wheel = Wishes(wheel_diameter=0.1524)  # six inches

    for answer in (recorded_in("rev", 0.5 / math.pi), recorded_in("m", 7.0)):
        found = robot_constants(answer, "java", wheel)
        assert found.unit == "m"
        assert found.feedforward["kV"].value == pytest.approx(1 / (GAIN * 0.0762))


@pytest.mark.parametrize(
    ("wishes", "why"),
    [
        (Wishes(unit="m"), r"`unit=m`: .* give `wheel_diameter=\.\.\.` as well"),
        (Wishes(unit="rev", wheel_diameter=0.1), "choose `unit=m`"),
        (Wishes(unit="furlong"), "furlong"),
        (Wishes(unit="s"), "isn't a unit of position"),
        (Wishes(measurement_delay=0.1, closed_loop=0.06), "a measurement 0.1 s late"),
    ],
)
def test_what_does_not_fit_is_reported(answer: ResultSummary, wishes: Wishes, why: str) -> None:
    for target in TARGETS_OF_ROBOTS:
        with pytest.raises(UsageError, match=why):
            TARGETS[target]().render(answer, wishes, "drive")


def test_an_elevator_has_kg_and_an_arm_kcos(tmp_path: Path) -> None:
    elevator = with_parameters(offset_voltage=(0.7, 0.01, "V"))
    # 0.3 sin θ + 0.4 cos θ = 0.5 cos(θ - atan2(3, 4)), by hand.
    arm = with_parameters(
        offset_voltage=(0.2, 0.01, "V"), gravity_voltage_sine=(0.3, 0.02, "V"), gravity_voltage_cosine=(0.4, 0.02, "V")
    )  # fmt: skip

    of_elevator, of_arm = (robot_constants(each, "java", Wishes(unit="deg")) for each in (elevator, arm))

    assert of_elevator.feedforward["kG"].value == 0.7
    assert "kG" not in of_arm.feedforward
    kcos = of_arm.feedforward["kCos"]
    assert kcos.value == pytest.approx(0.5)
    assert kcos.sd == pytest.approx(0.02)  # both parts are known as well, and along no direction better
    assert of_arm.level_angle == pytest.approx(math.degrees(math.atan2(3, 4)))
    assert "new ElevatorFeedforward(kS, kG, kV, kA)" in written(elevator, "java", tmp_path).read_text()
    (tmp_path / LANGUAGES["java"]).unlink()
    assert "new ArmFeedforward(kS, kCos, kV, kA)" in written(arm, "java", tmp_path).read_text()


def test_friction_that_differs_by_direction_is_its_mean() -> None:
    made = document(structure="first_order_asymmetric")
    coulomb = made["parameters"].pop("coulomb_voltage")
    made["parameters"] |= {
        "coulomb_voltage_forward": {**coulomb, "value": 0.3},
        "coulomb_voltage_backward": {**coulomb, "value": 0.1},
    }
    matrix = np.diag([1e-4, 1e-8, 1e-8, 1e-4, 1e-4]).tolist()
    made["covariance"] = {"parameters": list(made["parameters"]), "matrix": matrix}

    found = robot_constants(ResultSummary.from_document(made, "x"), "java", Wishes()).feedforward

    assert found["kS"].value == pytest.approx(0.2)
    assert found["kS"].sd == pytest.approx(math.sqrt(0.5) * 0.01)
    assert found["kG"].value == pytest.approx(0.1)


def test_what_is_only_bounded_is_said_so_and_is_never_negative(tmp_path: Path) -> None:
    made = document()
    made["parameters"]["time_constant"] |= {"value": 0.05, "sd": 0.2, "interval": [-0.3, 0.45]}
    made["parameters"]["coulomb_voltage"] |= {"value": 0.1, "sd": 0.2, "interval": [-0.2, 0.5]}
    made["covariance"]["matrix"][1][1] = 0.04
    answer = ResultSummary.from_document(made, "x")

    text = written(answer, "java", tmp_path).read_text()

    found = robot_constants(answer, "java", Wishes()).feedforward
    assert found["kA"].interval[0] == 0.0
    assert found["kA"].interval[1] <= 0.45 / (GAIN - 0.04)
    assert found["kS"].interval == (0.0, 0.5)
    assert "95 %: at most 0.5" in text
    assert len(next_tests_of(answer, 0.02)) >= 1


def test_what_is_known_needs_no_more_tests(answer: ResultSummary) -> None:
    assert next_tests_of(answer, 0.02) == ()


def test_a_late_measurement_makes_the_loop_slower(answer: ResultSummary) -> None:
    soon, late = (robot_constants(answer, "java", Wishes(measurement_delay=d)).gains for d in (None, 0.03))

    assert late.dead_time == pytest.approx(soon.dead_time + 0.03)
    assert soon.dead_time == pytest.approx(0.02 + DELAY)
    assert late.speed_gain < soon.speed_gain
    # The same gains bear 30 ms less of a further delay: the margin is that of the loop with the delay in it.
    same = [
        robot_constants(answer, "java", Wishes(measurement_delay=d, closed_loop=0.2)).gains
        for d in (None, 0.03)
    ]
    assert same[1].delay_margin[0] < same[0].delay_margin[0] + 0.03


def test_the_json_says_the_same(answer: ResultSummary, tmp_path: Path) -> None:
    (file,) = export(answer, "wpilib", tmp_path / "gains", Wishes(unit="rev"))
    code = numbers(written(answer, "java", tmp_path, Wishes(unit="rev")).read_text())

    told = json.loads(file.read_text(encoding="utf-8"))
    for name, each in told["feedforward"].items():
        assert code[name] == pytest.approx(each["value"], abs=0.1 * each["sd"])
    assert code["kVelocityP"] == pytest.approx(told["feedback"]["velocity"]["kP"]["value"], rel=1e-5)


def test_a_vague_delay_makes_the_default_loop_slower_until_it_is_safe(answer: ResultSummary) -> None:
    """A wished loop is as it was wished, and the file says that it may be unsafe."""
    names = list(answer.estimates)
    at = names.index("delay")
    covariance = answer.covariance.copy()
    covariance[at, at] = 0.04**2
    vague = replace(answer, covariance=covariance)

    usual, slower = (robot_constants(each, "java", Wishes()) for each in (answer, vague))
    wished = robot_constants(vague, "java", Wishes(closed_loop=usual.gains.closed_loop))

    assert usual.gains.phase_margin[1] >= math.radians(30)
    assert slower.gains.phase_margin[1] >= math.radians(30)
    assert slower.gains.closed_loop > usual.gains.closed_loop
    assert wished.gains.closed_loop == usual.gains.closed_loop
    assert wished.gains.phase_margin[1] < math.radians(30)
    assert any("may be unsafe" in note for note in wished.notes)
    assert not any("may be unsafe" in note for note in (*usual.notes, *slower.notes))


def test_a_gain_that_is_not_known_gives_no_code(answer: ResultSummary, tmp_path: Path) -> None:
    document = json.loads(json.dumps(answer.document))
    document["parameters"]["gain"]["state"] = "unknown"

    with pytest.raises(NotIdentifiable, match="don't determine the gain"):
        written(replace(answer, document=document), "java", tmp_path)


def test_the_code_says_for_which_voltages_it_holds(answer: ResultSummary, tmp_path: Path) -> None:
    local = replace(answer, input_range=(0.35, 0.44))

    assert "between 0.35 and 0.44 V" in written(local, "cpp", tmp_path).read_text()
