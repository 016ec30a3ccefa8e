"""Each target's file, read back by the program it is for or by a second calculation."""

import csv
import io
import json
import math
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import control
import numpy as np
import pytest

from servobench.core.errors import UsageError
from servobench.export.base import TARGETS, Wishes, export
from servobench.export.first_order import first_order_motor
from servobench.export.summary import ResultSummary
from servobench.export.tuning import tune_loops
from tests.export.conftest import COULOMB, DELAY, GAIN, SD, TAU, document, known_together

EVERYTHING = Wishes(
    unit="rad", sample_time=0.002, inertia=2.1e-5, closed_loop=0.03, counts_per_rev=2048, voltage_limit=10.0,
    measurement_delay=0.001,
)  # fmt: skip


def wishes_of(target: str) -> Wishes:
    """Return all wishes that a target follows."""
    named = TARGETS[target].wishes & {
        name for name in vars(EVERYTHING) if getattr(EVERYTHING, name) is not None
    }
    return Wishes(**{name: getattr(EVERYTHING, name) for name in named})


def rendered(answer: ResultSummary, target: str, wishes: Wishes | None = None) -> bytes:
    """Return the content of a target's first file."""
    return next(iter(TARGETS[target]().render(answer, wishes or wishes_of(target), "motor").values()))


@pytest.mark.parametrize("target", TARGETS.names())
def test_files_are_written_whole_under_the_names_asked_for(
    answer: ResultSummary, target: str, tmp_path: Path
) -> None:
    written = export(answer, target, tmp_path / "mine", wishes_of(target))

    assert written[0] == tmp_path / f"mine{TARGETS[target].suffix}"
    assert sorted(written) == sorted(tmp_path.iterdir())
    assert all(file.stat().st_size > 100 for file in written)


@pytest.mark.parametrize("target", TARGETS.names())
def test_a_wish_that_a_target_can_t_follow_is_refused(
    answer: ResultSummary, target: str, tmp_path: Path
) -> None:
    if TARGETS[target].wishes >= {"unit", "inertia"}:
        pytest.fail("no target follows both; choose another pair")
    wish = "inertia" if "inertia" not in TARGETS[target].wishes else "unit"

    with pytest.raises(UsageError, match=f"`{wish}="):
        export(answer, target, tmp_path / "m", Wishes(**{wish: getattr(EVERYTHING, wish)}))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_a_number_that_can_t_be_is_refused(answer: ResultSummary, value: float, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"`sample_time=\.\.\.` is .*expected a positive number"):
        export(answer, "wpilib", tmp_path / "m", Wishes(sample_time=value))


def test_a_sample_time_longer_than_the_time_constant_is_refused(
    answer: ResultSummary, tmp_path: Path
) -> None:
    wishes = Wishes(sample_time=1.0, voltage_limit=10.0)

    with pytest.raises(UsageError, match=r"`sample_time=1`: .* its time constant is 0\.0"):
        export(answer, "c", tmp_path / "m", wishes)


def test_json_is_the_result(answer: ResultSummary) -> None:
    assert json.loads(rendered(answer, "json")) == document()


def test_csv_has_a_row_for_each_parameter_and_no_formula(answer: ResultSummary) -> None:
    rows = list(csv.DictReader(io.StringIO(rendered(answer, "csv").decode())))

    assert [row["parameter"] for row in rows] == list(answer.estimates)
    assert float(rows[0]["value"]) == GAIN
    assert float(rows[0]["high"]) - float(rows[0]["low"]) == pytest.approx(2 * 1.959964 * SD["gain"])
    odd = document()
    odd["parameters"]["delay"]["unit"] = "=HYPERLINK(1)"
    table = rendered(ResultSummary.from_document(odd, "x"), "csv").decode()
    assert not re.search(r"(^|,)[=+@-](?![0-9.])", table, re.MULTILINE)


@pytest.mark.parametrize("target", ["control", "matlab", "mujoco", "c", "wpilib", "java", "cpp", "python"])
def test_every_file_says_what_the_data_do_not_determine(target: str) -> None:
    wishes = {"mujoco": Wishes(inertia=2e-5), "c": Wishes(sample_time=0.002)}.get(target, Wishes())

    text = rendered(ResultSummary.from_document(known_together(), "the result"), target, wishes).decode()

    assert "The time constant isn't known by itself; time constant + delay is" in text
    assert "The Coulomb voltage isn't known, only that it is at most 0.41 V." in text
    assert re.search("The values of .* and .* are one choice of many that fit the data equally well", text)
    assert "record other levels for a wider range" in text


def test_csv_has_states_and_known_combinations() -> None:
    table = rendered(ResultSummary.from_document(known_together(), "the result"), "csv").decode()

    rows = {row["parameter"]: row for row in csv.DictReader(io.StringIO(table))}
    assert [rows[name]["state"] for name in ("gain", "time_constant", "coulomb_voltage")] == [
        "known",
        "combination",
        "bounded",
    ]
    assert float(rows["time constant + delay"]["low"]) == 0.0976
    assert rows["time constant + delay"]["state"] == "known"


def test_python_control_gets_the_same_system(answer: ResultSummary) -> None:
    names: dict[str, Any] = {}
    exec(compile(rendered(answer, "control"), "motor.py", "exec"), names)

    omega = np.array([0.5, 10.0, 200.0])
    expected = GAIN / (1j * omega * TAU + 1) * np.exp(-1j * omega * DELAY)
    # A second-order Padé approximation is (ω d)⁵/720 off in phase, 5e-9 at 200 rad/s.
    assert names["motor"]()(1j * omega) == pytest.approx(expected, rel=1e-7)
    assert names["motor"](position=True)(1j * omega) == pytest.approx(expected / (1j * omega), rel=1e-7)
    assert names["motor"]().input_labels == ["input"]
    assert names["PARAMETERS"]["gain"][0] == GAIN


def test_matlab_s_variables_come_back(answer: ResultSummary, tmp_path: Path) -> None:
    from scipy.io import loadmat

    export(answer, "matlab", tmp_path / "motor.m")
    motor = loadmat(tmp_path / "motor.mat", simplify_cells=True)["motor"]

    assert motor["numerator"] == GAIN
    assert list(motor["denominator"]) == [TAU, 1.0]
    assert motor["delay"] == DELAY
    assert motor["parameters"]["time_constant"]["sd"] == SD["time_constant"]
    assert np.array_equal(motor["covariance"], answer.covariance)
    assert list(motor["covariance_of"]) == list(answer.estimates)


def test_octave_runs_the_script(answer: ResultSummary, tmp_path: Path) -> None:
    octave = shutil.which("octave-cli") or shutil.which("octave")
    if octave is None:
        pytest.skip("octave is absent: nothing here runs MATLAB's language")
    export(answer, "matlab", tmp_path / "motor.m")
    code = "pkg load control; motor; g = freqresp(motor, 7); printf('%.15g %.15g %.15g', real(g), imag(g), delay)"
    ended = subprocess.run(
        [octave, "--no-gui", "--eval", code], cwd=tmp_path, capture_output=True, text=True, timeout=120
    )
    if "package" in ended.stderr and "control" in ended.stderr and not ended.stdout:
        pytest.skip("octave is absent: its control package is not installed")

    real, imaginary, delay = map(float, ended.stdout.split()[-3:])
    assert complex(real, imaginary) == pytest.approx(GAIN / (7j * TAU + 1))
    assert delay == DELAY


@pytest.mark.parametrize("name", ["1motor", "my-motor", "a b", "ä"])
def test_names_that_a_language_can_t_have_are_refused(
    answer: ResultSummary, name: str, tmp_path: Path
) -> None:
    for target in ("matlab", "c", "java", "cpp", "python"):
        with pytest.raises(UsageError, match="choose such a name"):
            export(answer, target, tmp_path / name, wishes_of(target))


def test_wpilib_s_constants_drive_the_motor_as_it_moves(answer: ResultSummary) -> None:
    told = json.loads(rendered(answer, "wpilib", Wishes(unit="rev")))["feedforward"]

    # dω/dt from kS + kV ω + kA a, put into τ dω/dt = -ω + K (u - u_c) by hand, in revolutions.
    speed, acceleration = 3.0, 11.0
    volts = told["kS"]["value"] + told["kV"]["value"] * speed + told["kA"]["value"] * acceleration
    gain = GAIN / (2 * math.pi)
    assert (-speed + gain * (volts - COULOMB)) / TAU == pytest.approx(acceleration)
    assert told["kV"]["unit"] == "V·s/rev"


def test_wpilib_s_intervals_are_those_of_draws(answer: ResultSummary) -> None:
    told = json.loads(rendered(answer, "wpilib"))["feedforward"]
    drawn = np.random.default_rng(3).multivariate_normal([GAIN, TAU], answer.covariance[:2, :2], size=200_000)

    for name, values in {"kV": 1 / drawn[:, 0], "kA": drawn[:, 1] / drawn[:, 0]}.items():
        low, high = np.quantile(values, (0.025, 0.975))
        # A quantile of 200,000 draws scatters by 0.006 sd, the second order of the ratio is less than that.
        assert told[name]["interval"] == pytest.approx([low, high], abs=0.03 * told[name]["sd"])


def test_the_margin_left_is_that_of_the_loop_as_it_runs(answer: ResultSummary) -> None:
    told = json.loads(rendered(answer, "wpilib", Wishes(unit="rad")))["feedback"]

    # By python-control: the motor behind a hold of 20 ms and its delay as a part of a tick, the speed as a difference, a PI whose
    # integral has the error of its own tick.
    h, kp, ki = 0.02, told["velocity"]["kP"]["value"], told["velocity"]["kI"]["value"]
    a, late, both = math.exp(-h / TAU), math.exp(-(h - DELAY) / TAU), math.exp(-h / TAU)
    # Angle and speed after a tick: of u[k] for h - d, of u[k-1] for d before it.
    z = control.tf([1, 0], [1], h)
    speed = GAIN * ((1 - late) + (late - both) / z) / (z - a)
    drift = GAIN * ((h - DELAY - TAU * (1 - late)) + (DELAY - TAU * (late - both)) / z)
    angle = (drift + TAU * (1 - a) * speed) / (z - 1)
    loop = (kp + ki * h * z / (z - 1)) * (z - 1) / (h * z) * angle
    _, degrees, _, crossover = control.margin(control.minreal(loop, 1e-6, verbose=False))
    assert told["phase_margin"]["value"] == pytest.approx(degrees, rel=1e-5)
    assert told["delay_margin"]["value"] == pytest.approx(math.radians(degrees) / crossover, rel=1e-5)
    low, high = told["phase_margin"]["interval"]
    assert low < told["phase_margin"]["value"] < high


def test_the_loop_of_the_c_controller_bears_the_delay_that_it_says(answer: ResultSummary) -> None:
    """Tick by tick with the law as the C text has it: filtered differences of counts, an integral that is added afterwards."""
    h, counts = 0.002, 4096 * 1e6
    motor = first_order_motor(answer, "c")
    gains = tune_loops(motor, h, filtered=True, integral_lag=1)
    share = 1 - math.exp(-h / gains.filter)

    def swings(delay: float) -> tuple[float, float]:
        whole, part = divmod(delay, h)
        inputs, integral, filtered, speed, angle, before = [0.0] * (int(whole) + 2), 0.0, 0.0, 5.0, 0.0, 0.0
        course = []
        for _ in range(6000):
            seen = math.floor(angle * counts) / counts
            filtered += share * ((seen - before) / h - filtered)
            before = seen
            inputs = [-gains.speed_gain * filtered + integral, *inputs[:-1]]
            integral -= gains.speed_integral * h * filtered
            for volts, length in ((inputs[-1], part), (inputs[-2], h - part)):
                fall = 1 - math.exp(-length / TAU)
                angle += GAIN * volts * length + TAU * fall * (speed - GAIN * volts)
                speed += fall * (GAIN * volts - speed)
            course.append(abs(speed))
        return max(course[3000:4000]), max(course[5000:])

    early, late = swings(DELAY + 0.98 * gains.delay_margin[0])
    assert late < early
    early, late = swings(DELAY + 1.02 * gains.delay_margin[0])
    assert late > early


@pytest.mark.parametrize("target", ["control", "matlab", "mujoco", "c", "wpilib"])
def test_a_delay_below_zero_or_that_may_be_none_is_left_out_in_a_sentence(target: str) -> None:
    wishes = {
        "mujoco": Wishes(inertia=2e-5),
        "c": Wishes(sample_time=0.002),
    }.get(target, Wishes())
    for delay, interval in ((-0.0002, [-0.0004, 0.0001]), (0.0002, [-0.0001, 0.0005])):
        made = document()
        made["parameters"]["delay"] |= {"value": delay, "interval": interval}
        made["transfer_function"]["delay"] = delay
        text = rendered(ResultSummary.from_document(made, "the result"), target, wishes).decode()
        if delay < 0 or target in {"control", "matlab", "mujoco"}:
            assert f"The delay of {1000 * delay:.3g} ms is left out: its 95 % interval includes zero." in text
        else:  # gains allow for the delay as it is estimated
            assert "is left out" not in text
    plain = rendered(ResultSummary.from_document(document(), "the result"), target, wishes).decode()
    assert "is left out" not in plain


def test_a_loop_faster_than_the_dead_time_is_refused(answer: ResultSummary) -> None:
    with pytest.raises(UsageError, match="can't be faster"):
        rendered(answer, "wpilib", Wishes(closed_loop=0.01))


def test_kg_is_there_only_where_an_offset_is(answer: ResultSummary) -> None:
    for offset, known in ((0.5, True), (0.0001, False)):
        loaded = document()
        loaded["parameters"]["offset_voltage"] = {
            "value": offset, "sd": 0.01, "interval": [offset - 0.02, offset + 0.02], "level": 0.95, "unit": "V"
        }  # fmt: skip
        loaded["covariance"] = {
            "parameters": list(loaded["parameters"]),
            "matrix": np.diag([*np.diag(answer.covariance), 1e-4]).tolist(),
        }
        told = json.loads(rendered(ResultSummary.from_document(loaded, "x"), "wpilib"))
        assert ("kG" in told["feedforward"]) is known


def test_an_input_that_is_no_voltage_is_refused() -> None:
    duty = document()
    duty["transfer_function"]["unit"] = "rad/(s·%)"

    for target in ("wpilib", "mujoco", "c"):
        with pytest.raises(UsageError, match="input of this result is in %"):
            rendered(ResultSummary.from_document(duty, "x"), target)


def test_a_motor_of_higher_order_has_no_feedforward_of_the_first() -> None:
    second = document(structure="rational_2_0_integrator")
    second["transfer_function"]["denominator"] = [1e-4, TAU, 1.0]

    with pytest.raises(UsageError, match="rational_2_0_integrator"):
        rendered(ResultSummary.from_document(second, "x"), "wpilib")
    assert rendered(ResultSummary.from_document(second, "x"), "control")


def test_mujoco_s_joint_moves_as_the_motor(answer: ResultSummary) -> None:
    import mujoco

    model = mujoco.MjModel.from_xml_string(
        rendered(answer, "mujoco", Wishes(inertia=2.1e-5, sample_time=1e-4)).decode()
    )
    data = mujoco.MjData(model)
    data.ctrl[0] = 2.0
    speeds = []
    for _ in range(5000):
        mujoco.mj_step(model, data)
        speeds.append(float(data.sensor("speed").data[0]))

    t = 1e-4 * np.arange(1, 5001)
    exact = GAIN * (2.0 - COULOMB) * (1 - np.exp(-t / TAU))
    # The implicit Euler step is h/(2 τ) = 0.05 % of the motion off; the soft friction of MuJoCo takes up to 1 % of its part.
    allowed = 0.0005 * exact[-1] + 0.01 * GAIN * COULOMB
    assert np.abs(np.array(speeds) - exact).max() < allowed
    data.ctrl[0] = 0.5 * COULOMB  # less than friction holds
    for _ in range(20_000):
        mujoco.mj_step(model, data)
    # Soft friction creeps a little where real friction holds.
    assert abs(float(data.sensor("speed").data[0])) < 0.01 * GAIN * COULOMB


def test_mujoco_names_the_inertia_that_the_result_has(answer: ResultSummary) -> None:
    inertia = {
        "value": 2.0943e-5,
        "sd": 5e-9,
        "interval": [2.093e-5, 2.095e-5],
        "level": 0.95,
        "unit": "kg·m²",
    }
    document = {**answer.document, "motor_parameters": {"inertia": inertia}}

    with pytest.raises(UsageError, match=r"has one: give `inertia=2\.094e-05`"):
        rendered(replace(answer, document=document), "mujoco", Wishes())


def test_mujoco_asks_for_the_inertia(answer: ResultSummary) -> None:
    with pytest.raises(UsageError, match="`inertia="):
        rendered(answer, "mujoco", Wishes())


@pytest.mark.parametrize("counts", [None, 2048.0])
def test_the_c_controller_does_what_its_vectors_say(
    answer: ResultSummary, counts: float | None, tmp_path: Path
) -> None:
    wishes = Wishes(sample_time=0.002, counts_per_rev=counts, voltage_limit=10.0)
    (file,) = export(answer, "c", tmp_path / "motor.c", wishes)

    assert ran(file) == (0, "240 ticks, at most 0 V off\n")
    broken = tmp_path / "broken" / "motor.c"
    broken.parent.mkdir()
    broken.write_text(re.sub(r"(_KP) (\d\.\d)", r"\1 1\2", file.read_text()))
    status, said = ran(broken)
    assert status == 1, said


def test_the_c_controller_brings_the_motor_where_it_should_be(answer: ResultSummary) -> None:
    text = rendered(answer, "c", Wishes(sample_time=0.002, voltage_limit=10.0)).decode()
    block = re.search(r"inputs\[240\]\[2\] = \{\n(.*?)\n\};", text, re.DOTALL)
    assert block is not None
    rows = [re.findall(r"NAN|[-+0-9.e]+", row) for row in block[1].splitlines()]
    wished = np.array([float(r[0].replace("NAN", "nan")) for r in rows])
    speed = np.array([float(r[1]) for r in rows])

    # 40 ticks of 2 ms are 3.2 closed-loop time constants of τ/4: all but 4 % of a step is done, and friction, which the vectors'
    # motor doesn't have, pushes it ahead by less than K u_c.
    assert abs(speed[79] - wished[79]) < 0.06 * wished[79] + GAIN * COULOMB
    assert abs(speed[119] - wished[119]) < 0.06 * abs(wished[119] - wished[79]) + GAIN * COULOMB


def ran(file: Path) -> tuple[int, str]:
    """Compile a C file with its self-test, warnings being errors, run it, and return its status and what it printed."""
    compiler = shutil.which("cc")
    assert compiler is not None, "a C compiler is needed: apt-get install gcc"
    program = file.with_suffix(".out")
    options = [
        "-std=c99",
        "-Wall",
        "-Wextra",
        "-Wconversion",
        "-Wno-unused-function",
        "-Werror",
        "-pedantic",
        "-O2",
        "-DMOTOR_SELF_TEST",
    ]
    subprocess.run([compiler, *options, str(file), "-o", str(program), "-lm"], check=True, timeout=60)
    ended = subprocess.run([str(program)], capture_output=True, text=True, timeout=60)
    return ended.returncode, ended.stdout
