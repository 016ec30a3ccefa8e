"""Programs in the styles that are common for the board run unmodified, and leave the motor at rest."""

import re
import signal
import subprocess
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest

from tests import forks

SCRIPTS = Path(__file__).parent / "scripts"
GAIN = 1 / 0.042  # rad/(s·V), of a motor without friction


def run(
    script: Path | str, *options: str, arguments: tuple[str, ...] = (), folder: Path | None = None
) -> subprocess.CompletedProcess[str]:
    """Run a program on the stand-in, in a fork."""
    words = ["-m", "servobench.compat.quanser", *options, str(script), *arguments]
    return forks.run(words, cwd=folder or Path.cwd())


def run_to_the_end(script: Path) -> subprocess.CompletedProcess[str]:
    """Run a program on the stand-in by an interpreter of its own, whose end is not that of a fork."""
    command = [sys.executable, "-m", "servobench.compat.quanser", str(script)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, input="\n", check=False)


Ends = Callable[[str], subprocess.CompletedProcess[str]]


@pytest.fixture(scope="module")
def end_of_script() -> Ends:
    """The end of a script that several tests look at, which runs once; again where a busy computer has a test tried again."""
    return cache(lambda name: run(SCRIPTS / f"{name}.py"))


def written(folder: Path, text: str) -> Path:
    """A program of that text."""
    path = folder / "program.py"
    path.write_text(text, encoding="utf-8")
    return path


OPEN = """
import sys, time, numpy as np
from quanser.hardware import HIL, HILError
one = np.array([0], dtype=np.uint32)
card = HIL("qube_servo2_usb", "0")
card.write_digital(one, 1, np.array([1], dtype=np.int8))
card.write_analog(one, 1, np.array([2.0]))
time.sleep(1.0)
"""


@pytest.mark.parametrize("name", ["immediate", "hardware_timed", "filtered_control", "watchdog"])
def test_a_program_runs_and_says_that_it_was_a_stand_in_and_that_the_motor_is_at_rest(
    name: str, end_of_script: Ends
) -> None:
    ended = end_of_script(name)

    assert ended.returncode == 0, ended.stderr
    assert "Unable" not in ended.stdout
    assert ended.stderr.count("a stand-in for the QUBE-Servo") == 1
    assert "simulated hardware only" in ended.stderr
    assert ended.stderr.rstrip().endswith(": 0 V, amplifier off.")


def test_immediate_calls_turn_the_motor_as_far_as_its_equations_say(end_of_script: Ends) -> None:
    ended = end_of_script("immediate")

    found = re.fullmatch(r"(\d+) counts after 1\.\d+ s\n", ended.stdout)
    assert found
    # K (V - V_c) (t - τ), with τ = 0.1 s and the Coulomb voltage of 0.16 V, for t = 1 s; 1 % for the calls' own time.
    expected = GAIN * (2 - 0.16) * (1.0 - 0.0998) * 2048 / (2 * 3.14159)
    assert abs(int(found[1]) - expected) < 0.01 * expected


def test_a_task_times_a_loop_without_losing_a_sample(end_of_script: Ends) -> None:
    ended = end_of_script("hardware_timed")

    # Friction stops a proportional loop within V_c / k_p = 0.16 / 3 = 0.05 rad of its goal.
    found = re.fullmatch(r"position (\d\.\d+) rad, 0 overflows\n", ended.stdout)
    assert found
    assert abs(float(found[1]) - 3.14) < 0.06


def test_a_starved_watchdog_lets_the_motor_go_and_refuses_until_it_is_cleared(end_of_script: Ends) -> None:
    lines = end_of_script("watchdog").stdout.splitlines()

    # With the twin's viscous friction the gain is 23.70 rad/(s·V), so that 3 V less 0.16 V of friction give 67.3 rad/s.
    assert lines == ["fed: 67 rad/s", "refused", "True False", "starved: 0 rad/s"]


def test_a_pendulum_that_somebody_lifts_is_balanced() -> None:
    ended = run(SCRIPTS / "balance.py", "--pendulum")

    found = re.fullmatch(r"balanced for (\d+\.\d) s, the arm at (-?\d\.\d) rad\n", ended.stdout)
    assert found, ended.stdout + ended.stderr
    assert float(found[1]) > 6.0  # the hand lifts for 3 s after 2 s, of 12 s in all
    assert abs(float(found[2])) < 0.5


@pytest.mark.parametrize(
    ("ending", "status"),
    [
        ("", 0),
        ("sys.exit(3)", 3),
        ("raise SystemExit", 0),
        ("1 / 0", 1),
        ("raise KeyboardInterrupt", 130),
        ("import os, signal; os.kill(os.getpid(), signal.SIGTERM)", -signal.SIGTERM),
        ("card.close()", 0),
    ],
)
def test_the_motor_is_at_rest_however_a_program_ends(ending: str, status: int, tmp_path: Path) -> None:
    ended = run_to_the_end(written(tmp_path, OPEN + ending))

    assert ended.returncode == status
    last = ended.stderr.rstrip().splitlines()[-1]
    assert last.startswith("servobench: end: QUBE-Servo 2: 0 V, amplifier off, by the stand-in")
    assert "left 2 V, amplifier on" in last
    assert ("never closed the board" in last) == (ending != "card.close()")


def test_what_a_program_does_at_its_exit_still_finds_the_board(tmp_path: Path) -> None:
    program = OPEN + (
        "import atexit\ndef end():\n    card.write_analog(one, 1, np.zeros(1))\n"
        "    card.write_digital(one, 1, np.array([0], dtype=np.int8))\n    card.close()\natexit.register(end)\n"
    )
    ended = run_to_the_end(written(tmp_path, program))

    assert ended.stderr.rstrip().endswith("QUBE-Servo 2: 0 V, amplifier off.")


def test_an_error_of_the_program_is_shown_without_the_frames_of_the_stand_in(tmp_path: Path) -> None:
    ended = run_to_the_end(written(tmp_path, OPEN + "1 / 0"))

    assert "ZeroDivisionError" in ended.stderr
    assert "runpy" not in ended.stderr


def test_a_program_gets_its_arguments_its_folder_and_its_name(tmp_path: Path) -> None:
    (tmp_path / "neighbour.py").write_text("value = 7\n", encoding="utf-8")
    program = written(tmp_path, "import sys, neighbour\nprint(__name__, sys.argv[1:], neighbour.value)\n")

    assert run(program, arguments=("a", "--b")).stdout == "__main__ ['a', '--b'] 7\n"


def test_a_program_that_isnt_there_is_a_sentence_and_status_2(tmp_path: Path) -> None:
    ended = run(tmp_path / "gone.py")

    assert (ended.returncode, ended.stderr.startswith("no such file: ")) == (2, True)


def test_an_endless_program_ends_at_ctrl_c_by_its_own_handler(tmp_path: Path) -> None:
    program = OPEN + (
        "import signal\nstop = False\ndef end(*_):\n    global stop\n    stop = True\nsignal.signal(signal.SIGINT, end)\n"
        "task = card.task_create_encoder_reader(100, one, 1)\ncard.task_start(task, 0, 1000, HIL.INFINITE)\n"
        "counts = np.zeros(1, dtype=np.int32)\nprint('running', flush=True)\n"
        "while not stop:\n    card.task_read_encoder(task, 1, counts)\n"
        "card.write_analog(one, 1, np.zeros(1))\ncard.write_digital(one, 1, np.array([0], dtype=np.int8))\n"
        "card.close()\nprint('ended')\n"
    )
    command = [sys.executable, "-m", "servobench.compat.quanser", str(written(tmp_path, program))]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as child:
        assert child.stdout is not None
        assert child.stdout.readline() == "running\n"
        child.send_signal(signal.SIGINT)
        out, err = child.communicate(timeout=300)

    assert (out, child.returncode) == ("ended\n", 0)
    assert err.rstrip().endswith("QUBE-Servo 2: 0 V, amplifier off.")


def test_two_threads_are_paced_by_the_wall_clock_and_both_get_on(tmp_path: Path) -> None:
    program = OPEN + (
        "import threading\nalive = True\ndef control():\n    for _ in range(100):\n"
        "        card.task_read_encoder(task, 1, counts)\n"
        "task = card.task_create_encoder_reader(1000, one, 1)\ncounts = np.zeros(1, dtype=np.int32)\n"
        "card.task_start(task, 0, 1000, HIL.INFINITE)\nthread = threading.Thread(target=control)\nthread.start()\n"
        "before = time.perf_counter()\nwhile thread.is_alive():\n    time.sleep(0.005)\n"
        "print(time.perf_counter() - before >= 0.09)\n"
    )

    assert run(written(tmp_path, program)).stdout == "True\n"


def test_a_board_that_is_unplugged_is_an_error_from_then_on(tmp_path: Path) -> None:
    program = OPEN + (
        "counts = np.zeros(1, dtype=np.int32)\n"
        "for k in range(100):\n    try:\n        card.read_encoder(one, 1, counts)\n"
        "    except HILError as error:\n        print(k, error.error_code)\n    time.sleep(0.1)\ncard.close()\n"
    )
    ended = run(written(tmp_path, program), "--unplug", "10")

    lines = ended.stdout.splitlines()
    first = int(lines[0].split()[0])
    assert [line.split() for line in lines] == [[str(k), "-41"] for k in range(first, 100)]
    assert first in range(88, 92)  # 9 s after the first second, at 0.1 s and a call each
    assert ended.stderr.rstrip().endswith("amplifier off, after it was unplugged.")


REST = (
    "card.write_analog(one, 1, np.zeros(1)); card.write_digital(one, 1, np.zeros(1, np.int8)); card.close()"
)
AT_REST = "servobench: end: QUBE-Servo 2: 0 V, amplifier off."


def last_line(ended: subprocess.CompletedProcess[str]) -> str:
    return ended.stderr.rstrip().splitlines()[-1]


@pytest.mark.parametrize(
    "wait",
    [
        "import threading; threading.Event().wait(0.5)",
        "import threading; threading.Semaphore(0).acquire(timeout=0.5)",
        "import queue\ntry: queue.Queue().get(timeout=0.5)\nexcept queue.Empty: pass",
        "import sched; s = sched.scheduler(time.time, time.sleep); s.enter(0.5, 1, int); s.run()",
        "while time.process_time() < before + 0.5: pass",
        "while time.clock_gettime(time.CLOCK_MONOTONIC) < before + 0.5: pass",
    ],
)
def test_what_waits_by_other_means_waits_in_simulated_time_too(wait: str, tmp_path: Path) -> None:
    program = (
        f"{OPEN}before = time.perf_counter()\n{wait}\nprint(round(time.perf_counter() - before, 3))\n{REST}"
    )

    assert run(written(tmp_path, program)).stdout == "0.5\n"


def test_an_installed_package_that_opens_the_board_sleeps_in_simulated_time(tmp_path: Path) -> None:
    package = tmp_path / "site-packages" / "environment"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text(
        "import time\nfrom quanser.hardware import HIL\n"
        "def make():\n    return HIL('qube_servo2_usb', '0')\ndef step():\n    time.sleep(2.0)\n",
        encoding="utf-8",
    )
    program = (
        f"import sys, time\nsys.path.insert(0, {str(package.parent)!r})\nimport environment\n"
        "card = environment.make()\nbefore = time.perf_counter()\nenvironment.step()\n"
        "print(round(time.perf_counter() - before, 3))\ncard.close()\n"
    )

    assert run(written(tmp_path, program)).stdout == "2.0\n"


def test_a_request_to_end_ends_at_once_as_under_python_and_tells_what_was_on_the_board(
    tmp_path: Path,
) -> None:
    program = (
        f"{OPEN}import atexit, os, signal\ndef end():\n    {REST}\natexit.register(end)\n"
        "try:\n    os.kill(os.getpid(), signal.SIGTERM)\nfinally:\n    end()\n"
    )
    ended = run_to_the_end(written(tmp_path, program))

    assert ended.returncode == -signal.SIGTERM
    assert "left 2 V, amplifier on, and never closed" in last_line(ended)


@pytest.mark.parametrize("more", ["", "q.self = q", "import atexit; atexit.register(lambda: q)", "1 / 0"])
def test_a_global_that_cleans_up_as_it_goes_still_finds_the_board(more: str, tmp_path: Path) -> None:
    program = f"{OPEN}class Q:\n    def __del__(self):\n        {REST}\nq = Q()\n{more}\n"
    ended = run_to_the_end(written(tmp_path, program))

    assert last_line(ended) == AT_REST
    assert "ignored" not in ended.stderr


def test_a_hook_of_the_program_for_errors_is_called_with_its_own_frames(tmp_path: Path) -> None:
    program = (
        f"{OPEN}import traceback\ndef hook(kind, error, trace):\n    {REST}\n"
        "    print(kind.__name__, [frame.name for frame in traceback.extract_tb(trace)])\n"
        "sys.excepthook = hook\n1 / 0\n"
    )
    ended = run_to_the_end(written(tmp_path, program))

    assert (ended.returncode, ended.stdout) == (1, "ZeroDivisionError ['<module>']\n")
    assert last_line(ended) == AT_REST


@pytest.mark.parametrize(
    "program",
    ["def f(:\n", "class Stop(BaseException): pass\nraise Stop", "import sys; sys.excepthook = 1\n1 / 0"],
)
def test_no_error_of_a_program_shows_frames_of_the_stand_in(program: str, tmp_path: Path) -> None:
    ended = run_to_the_end(written(tmp_path, program))

    assert ended.returncode == 1
    assert "Error" in ended.stderr or "Stop" in ended.stderr
    assert "quanser" not in ended.stderr.replace("quanser.hardware", "")


def test_a_program_finds_its_file_and_its_name_as_under_python(tmp_path: Path) -> None:
    written(tmp_path, "import sys\nprint(__file__)\nprint(sys.argv[0])\n")

    assert run("./program.py", folder=tmp_path).stdout == f"{tmp_path}/./program.py\n./program.py\n".replace(
        "/./", "/", 1
    )


@pytest.mark.skipif(not hasattr(__import__("os"), "fork"), reason="no child processes are forked off here")
def test_a_forked_child_that_leaves_a_voltage_does_not_make_the_last_line_untrue(tmp_path: Path) -> None:
    program = f"import os\nif os.fork():\n    os.wait()\nelse:\n    {OPEN.strip().replace(chr(10), chr(10) + '    ')}\n"
    ended = run_to_the_end(written(tmp_path, program))

    assert last_line(ended) == "servobench: end: this process opened no board."
    assert "child processes were started" in ended.stderr
    assert ended.stderr.count("servobench: end") == 1


def test_a_program_that_only_reads_raises_no_alarm(tmp_path: Path) -> None:
    program = (
        "import numpy as np\nfrom quanser.hardware import HIL\ncard = HIL('qube_servo2_usb', '0')\n"
        "card.read_encoder(np.zeros(1, np.uint32), 1, np.zeros(1, np.int32))\n"
    )
    line = last_line(run(written(tmp_path, program)))

    assert line.endswith("left 0 V, amplifier off, and never closed the board.")


@pytest.mark.parametrize(
    ("options", "sentence"),
    [(("--hand", "holds"), "needs --pendulum"), (("--unplug", "-1"), "give seconds, 0 or more")],
)
def test_options_that_make_no_sense_are_refused(
    options: tuple[str, ...], sentence: str, tmp_path: Path
) -> None:
    ended = run(written(tmp_path, ""), *options)

    assert ended.returncode == 2
    assert sentence in ended.stderr


def test_a_folder_is_not_called_missing(tmp_path: Path) -> None:
    ended = run(tmp_path)

    assert (ended.returncode, "is a folder" in ended.stderr) == (2, True)
