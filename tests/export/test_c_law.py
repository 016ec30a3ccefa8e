"""A tuned controller in C: compiled, and run on vectors that the law itself made."""

import json
import math
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from servobench.core.errors import FormatError, UsageError
from servobench.export.base import Wishes
from servobench.export.c_law import TunedLaw, export_law, law_of_tuning, read_tuning, text_of_law
from servobench.systems.control.lead import Lead
from servobench.systems.control.pid import Pid
from servobench.systems.control.state_feedback import StateFeedback
from servobench.systems.tuning.base import Tunable

LAWS: dict[str, Tunable] = {
    "pid of position": Pid(kp=4.0, kd=0.1, cutoff=80.0),
    "pid with integral": Pid(kp=2.0, ki=6.0, kd=0.1, b=0.4, c=0.7, cutoff=60.0),
    "pid of speed": Pid(output="speed", kp=0.05, ki=0.8, kd=0.001, cutoff=90.0),
    "integral alone": Pid(output="speed", kp=0.0, ki=0.5, cutoff=90.0),
    "tracking time": Pid(kp=2.0, ki=6.0, tracking_time=0.02),
    "lead of position": Lead(gain=3.0, zero=9.0, pole=70.0),
    "lead of speed": Lead(output="speed", gain=0.1, zero=9.0, pole=70.0, cutoff=50.0),
    "state feedback": StateFeedback(position_gain=3.0, speed_gain=0.1, integral_gain=5.0),
    "state feedback of speed": StateFeedback(
        output="speed", position_gain=0.0, speed_gain=0.1, integral_gain=0.6
    ),
    "state feedback alone": StateFeedback(position_gain=3.0, speed_gain=0.1, reference_gain=2.5),
}
STRICT = ["-std=c99", "-Wall", "-Wextra", "-pedantic", "-Werror"]


def tuned(controller: Tunable) -> TunedLaw:
    return TunedLaw(controller=controller, method="pole_placement", sample_time=0.004, voltage_limit=9.0)


def compiled(source: str, folder: Path, *options: str) -> Path:
    """The program of a C text; there is a compiler of C wherever the tests run."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    assert compiler is not None, "no C compiler (cc) on the path"
    (folder / "loop.c").write_text(source, encoding="ascii")
    subprocess.run(
        [compiler, *STRICT, *options, "loop.c", "-lm", "-o", "loop"], cwd=folder, check=True, timeout=120
    )
    return folder / "loop"


def ran(program: Path) -> tuple[int, str]:
    ended = subprocess.run([str(program)], capture_output=True, text=True, timeout=60)
    return ended.returncode, ended.stdout


@pytest.mark.parametrize("name", LAWS)
def test_the_c_law_gives_the_voltages_of_the_law(name: str, tmp_path: Path) -> None:
    text = text_of_law(tuned(LAWS[name]), 2048, "loop")

    status, said = ran(compiled(text, tmp_path, "-DLOOP_SELF_TEST"))

    assert status == 0, said
    match = re.search(r"at most (\S+) V off", said)
    assert match is not None
    # A thousand roundings of doubles beside a limit of 9 V.
    assert float(match[1]) < 1e-11
    block = re.search(r"volts\[240\] = \{(.*?)\};", text, re.DOTALL)
    assert block is not None
    volts = [float(each) for each in block[1].split(",")]
    assert max(volts) == 9.0  # the limit is reached
    assert len(set(volts)) > 100  # and isn't all that there is to see


@pytest.mark.parametrize("name", LAWS)
def test_another_gain_fails_the_self_test(name: str, tmp_path: Path) -> None:
    text = text_of_law(tuned(LAWS[name]), 2048, "loop")
    gain = next(each for each in ("KP", "GAIN", "K_SPEED") if f"LOOP_{each} " in text)
    gain = "KI" if name == "integral alone" else gain

    changed = re.sub(rf"(#define LOOP_{gain}) (\S+)", lambda m: f"{m[1]} {1.001 * float(m[2])!r}", text)

    assert changed != text
    assert ran(compiled(changed, tmp_path, "-DLOOP_SELF_TEST"))[0] == 1


def test_a_position_goes_on_where_the_counter_wraps(tmp_path: Path) -> None:
    law = text_of_law(tuned(Pid(kp=1.0)), 2048, "loop")
    main = """
#include <stdio.h>
int main(void)
{
    loop_state state;
    double before, after;
    loop_start(&state);
    before = loop_step(&state, 2147483647.0 * LOOP_SCALE, 2147483647);
    after = loop_step(&state, 2147483647.0 * LOOP_SCALE, -2147483647 - 1);
    printf("%.17g %.17g", before, after);
    return 0;
}
"""

    _, said = ran(compiled(law + main, tmp_path))

    before, after = map(float, said.split())
    assert before == pytest.approx(0.0, abs=1e-8)
    # One count further on; 2^31 counts in rad are exact to 1e-9.
    assert after == pytest.approx(-2 * math.pi / 2048, abs=1e-8)


def document(**changed: Any) -> dict[str, Any]:
    return {
        "schema": "servobench.tuning/1",
        "method": "pole_placement",
        "sample_time": 0.004,
        "voltage_limit": 9.0,
        "controller": {"type": "pid", "output": "position", "kp": 4.0},
        **changed,
    }


@pytest.mark.parametrize(
    "changed",
    [
        {"controller": {"type": "open_loop"}},
        {"controller": {"type": "pid", "kp": "much"}},
        {"controller": None},
        {"sample_time": 0.0},
        {"voltage_limit": -1.0},
        {"sample_time": None},
    ],
)
def test_a_damaged_tuning_is_reported(changed: dict[str, Any], tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=r"tuning\.json"):
        law_of_tuning(document(**changed), "tuning.json")


def test_a_file_of_something_else_is_no_tuning(tmp_path: Path) -> None:
    file = tmp_path / "x.json"
    for content in ("{", "[]", json.dumps({"schema": "servobench.result/2"})):
        file.write_text(content)
        assert read_tuning(file) is None
    assert read_tuning(tmp_path / "absent.json") is None
    file.write_text(json.dumps(document()))
    found = read_tuning(file)
    assert found is not None
    assert found.controller == Pid(kp=4.0)


@pytest.mark.parametrize("name", ["a-b.c", "loop.py", "1loop"])
def test_a_name_that_c_hasn_t_is_refused(name: str, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="choose such a name"):
        export_law(tuned(LAWS["pid of position"]), tmp_path / name, Wishes(counts_per_rev=2048))


@pytest.mark.parametrize("limit", [0.5, 24.0])
def test_a_limit_may_be_any_voltage_above_zero(limit: float) -> None:
    assert law_of_tuning(document(voltage_limit=limit), "tuning.json").voltage_limit == limit
