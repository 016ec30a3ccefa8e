"""`servobench run`: from the question to the folder with its five files, whatever happens on the way."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import Any, ClassVar

import pytest
from pydantic import BaseModel

import servobench as sb
from servobench.cli.run_folder import run_folder
from servobench.core.channels import Sample
from servobench.core.errors import DeviceError, StorageError, UsageError
from servobench.rig.devices.base import DEVICES
from servobench.rig.devices.twin import Twin
from servobench.rig.experiment import load_experiment
from tests.cli.conftest import Command, checked, environment, started

FILES = {"experiment.toml", "recording.mcap", "data.csv", "result.json", "report.html"}
SHORT = """
[experiment]
name = "short"
duration = "3 s"
sample_time = "2 ms"
[signal]
type = "square"
low = "1 V"
high = "3 V"
frequency = "0.4 Hz"
"""
# What comes from outside should end it: missed ticks don't, and a busy machine's watchdog as late as it may.
HOST = (
    SHORT.replace('"3 s"', '"300 s"')
    + '[device.settings]\ntiming = "host"\n[when_late]\nmissed = "process"\n[limits.watchdog]\ntimeout = "0.5 s"\n'
)


@pytest.fixture
def short(tmp_path: Path) -> Path:
    file = tmp_path / "short.toml"
    file.write_text(SHORT)
    return file


@pytest.fixture
def quick_report(monkeypatch: pytest.MonkeyPatch) -> None:
    """Write an empty page in place of the report, whose figures take longer than all the rest of a run."""
    monkeypatch.setattr("servobench.report.document.Report.html", lambda _: "<!doctype html>")


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_the_folder_of_a_run_holds_its_five_files(finished_run: Path) -> None:
    assert names(finished_run) == FILES


def test_the_default_run_finds_what_the_twin_was_made_of(finished_run: Path) -> None:
    result = checked(json.loads((finished_run / "result.json").read_text(encoding="utf-8")))

    # R = 8.4 Ω, L = 1.16 mH, k = 0.042, J = 2.0952e-5 kg·m², b = 1e-6, Coulomb 8e-4 N·m: with p(s) = (s L + R)(s J + b) + k²
    # the gain is k/(R b + k²) = 23.697, the slow root -1/0.09916 s; friction takes 8e-4 N·m · R/k = 0.16 V.
    assert result["verdict"] == "trusted"
    truth = {"gain": 0.042 / (8.4e-6 + 0.042**2), "time_constant": 0.09916, "coulomb_voltage": 0.16}
    for name, value in truth.items():
        assert result["parameters"][name]["value"] == pytest.approx(value, rel=1e-3)
    assert [each["name"] for each in result["nominal"]] == ["gain", "time_constant", "delay"]


@pytest.mark.usefixtures("quick_report")
def test_json_is_what_the_folder_holds_and_nothing_else_is_on_standard_output(
    servobench: Command, short: Path, tmp_path: Path
) -> None:
    ended = servobench("run", short, "--out", tmp_path / "run", "--json")

    assert ended.status == 0
    assert ended.result == json.loads((tmp_path / "run" / "result.json").read_text(encoding="utf-8"))
    assert "trusted: " in ended.err
    assert f"report: {tmp_path / 'run' / 'report.html'}" in ended.err


@pytest.mark.usefixtures("quick_report")
def test_words_tell_what_was_asked_and_where_the_report_is(
    servobench: Command, short: Path, tmp_path: Path
) -> None:
    ended = servobench("run", short, "--out", tmp_path / "run")

    assert ended.out.startswith(
        "short: square, 3 s at 500 Hz, on twin\n1500 samples; ran for 3 s, as asked\n"
    )
    assert ended.out.rstrip().endswith(f"report: {tmp_path / 'run' / 'report.html'}")
    assert "data sheet" in ended.out


@pytest.mark.usefixtures("quick_report")
def test_the_experiment_in_the_folder_runs_again_to_the_same_samples(
    servobench: Command, short: Path, tmp_path: Path
) -> None:
    first, again = tmp_path / "first", tmp_path / "again"
    servobench("run", short, "--out", first)

    assert servobench("run", first / "experiment.toml", "--out", again).status == 0

    assert (first / "experiment.toml").read_bytes() == (again / "experiment.toml").read_bytes()
    (one,), (other,) = sb.load(first / "recording.mcap"), sb.load(again / "recording.mcap")
    assert one.series == other.series


def test_the_seed_makes_the_noise(
    servobench: Command, short: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def spared(*_: object, **__: object) -> None:
        raise UsageError("only the recordings are compared here")

    monkeypatch.setattr("servobench.identification.identify.identify", spared)
    short.write_text(SHORT + "[device.settings]\ntorque_noise = 1e-5\n")
    counts = []
    for number, seed in enumerate((1, 1, 2)):
        folder = tmp_path / str(number)
        servobench("run", short, "--out", folder, "--seed", seed)
        (recording,) = sb.load(folder / "recording.mcap")
        counts.append(recording["counts"].values.tolist())

    assert counts[0] == counts[1] != counts[2]


@pytest.mark.usefixtures("quick_report")
def test_a_second_run_takes_the_place_of_the_first_when_asked_to_and_leaves_other_files(
    servobench: Command, short: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "run"
    servobench("run", "--out", folder)
    (folder / "notes.txt").write_text("mine")

    refused = servobench("run", short, "--out", folder)
    assert refused.status == 2
    assert "holds an earlier run; give another folder, or --overwrite" in refused.err

    assert servobench("run", short, "--out", folder, "--overwrite").status == 0

    assert names(folder) == FILES | {"notes.txt"}
    (recording,) = sb.load(folder / "recording.mcap")
    assert len(recording["counts"].values) == 1500


def test_a_folder_that_is_no_run_s_is_refused_and_left_as_it_is(
    servobench: Command, short: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "thesis"
    folder.mkdir()
    (folder / "experiment.toml").write_text("# mine, not servobench's")
    (folder / "recording.mcap").write_bytes(b"\x89MCAP0\r\n")

    ended = servobench("run", short, "--out", folder)

    assert ended.status == 2
    assert "isn't the folder of an earlier run" in ended.err
    assert names(folder) == {"experiment.toml", "recording.mcap"}


@pytest.mark.promise("S28")
@pytest.mark.usefixtures("quick_report")
def test_an_unfinished_recording_is_not_overwritten(servobench: Command, short: Path, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    servobench("run", short, "--out", folder)
    (folder / "recording.mcap").rename(folder / "recording.mcap.part")

    ended = servobench("run", short, "--out", folder)

    assert ended.status == 2
    assert "servobench recover" in ended.err
    assert (folder / "recording.mcap.part").exists()


@pytest.mark.usefixtures("quick_report")
def test_an_empty_folder_and_a_new_one_in_a_new_one_will_do(
    servobench: Command, short: Path, tmp_path: Path
) -> None:
    (tmp_path / "empty").mkdir()

    assert servobench("run", short, "--out", tmp_path / "empty").status == 0
    assert servobench("run", short, "--out", tmp_path / "a" / "b").status == 0


def test_out_can_be_no_file(servobench: Command, short: Path) -> None:
    ended = servobench("run", short, "--out", short)

    assert ended.status == 2
    assert "is a file" in ended.err
    assert short.read_text() == SHORT


def test_without_out_the_folder_is_new_and_called_after_the_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    noon = datetime(2024, 2, 29, 12, 0, 0)
    Path("run-20240229-120000").mkdir()

    with run_folder(None, noon) as first, run_folder(None, noon) as second:
        assert first.path == Path("run-20240229-120000-2")
        # Neither has written anything yet: the folder itself is what the other one sees.
        assert second.path == Path("run-20240229-120000-3")
        first.begin("")
        first.recording.write_bytes(b"")

    assert names(tmp_path) == {"run-20240229-120000", "run-20240229-120000-2", "run-20240229-120000-3"}


@pytest.mark.promise("S54")
def test_runs_that_begin_at_once_without_out_have_a_folder_each(short: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "servobench", "run", str(short), "--json", "--seed"]
    runs = [
        subprocess.Popen(
            [*command, seed],
            cwd=tmp_path,
            env=environment(),
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )
        for seed in ("1", "2")
    ]
    printed = [json.loads(run.communicate(timeout=300)[0]) for run in runs]

    folders = sorted(tmp_path.glob("run-*"))
    assert [names(folder) for folder in folders] == [FILES, FILES]
    kept = {
        load_experiment(folder / "experiment.toml").seed: json.loads(
            (folder / "result.json").read_text(encoding="utf-8")
        )
        for folder in folders
    }
    assert kept == {1: printed[0], 2: printed[1]}


@pytest.mark.promise("S54")
def test_a_folder_is_one_run_s_from_its_beginning_to_its_last_file(tmp_path: Path) -> None:
    out = tmp_path / "run"
    with run_folder(out, datetime.now()) as folder:
        for recorded in (False, True):
            if recorded:
                folder.begin("")
                folder.recording.write_bytes(b"\x89MCAP0\r\n")
            with (
                pytest.raises(UsageError, match="is being written by a running experiment"),
                run_folder(out, datetime.now()),
            ):
                pass
        assert folder.recording.exists()

    with run_folder(out, datetime.now(), overwrite=True) as again:
        again.begin("")
        assert not folder.recording.exists()


LIMITED = """
import resource, sys
from servobench.cli import main
sys.dont_write_bytecode = True  # else modules imported below are kept cut off, for whoever comes next
resource.setrlimit(resource.RLIMIT_FSIZE, (30_000, 30_000))  # bytes: about 400 rows
sys.exit(main(sys.argv[1:]))
"""


@pytest.mark.promise("S57")
@pytest.mark.skipif(os.name == "nt", reason="ulimit is POSIX's")
def test_a_run_under_a_limit_on_the_size_of_files_keeps_what_it_wrote(tmp_path: Path) -> None:
    file, folder = tmp_path / "run.toml", tmp_path / "run"
    for text, said in (
        (HOST, "bytes of shared memory aren't available: File too large; allow larger files (ulimit -f)"),
        (SHORT, "recording.mcap can't be written any further: File too large"),
    ):
        file.write_text(text)
        ended = subprocess.run(
            [sys.executable, "-c", LIMITED, "run", str(file), "--out", str(folder)],
            env=environment(),
            capture_output=True,
            encoding="utf-8",
            timeout=300,
        )
        assert ended.returncode == 5, ended.stderr
        assert said in ended.stderr
        assert folder.exists() == (text is SHORT)

    (recording,) = sb.load(folder / "recording.mcap.part")
    assert 100 < len(recording["counts"].values) < 1500


def test_a_run_that_was_killed_before_it_began_leaves_a_folder_that_the_next_one_may_have(
    tmp_path: Path,
) -> None:
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "experiment.toml").touch()

    with run_folder(tmp_path / "run", datetime.now()) as folder:
        folder.begin("")


def test_a_folder_that_can_t_be_made_is_a_storage_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")

    with (
        pytest.raises(StorageError, match="can't be written"),
        run_folder(tmp_path / "file" / "run", datetime.now()),
    ):
        pass


@pytest.mark.parametrize(
    ("wrong", "line", "said"),
    [
        ('[signal]\ntype = "sqare"\n', 2, "square"),
        ('[signal]\ntype = "square"\nlow = "1 A"\n', 3, "V"),
        ('[signal]\ntype = "square"\n[device.settings]\nresistance = "1 H"\n', 4, "ohm"),
        ('[signal]\ntype = "square"\n[device.settings]\nresistence = 1\n', 4, "resistance"),
        ('[signal]\ntype = "square"\n[device.settings]\nmotor = "qube"\n', 3, "qube_servo_2"),
    ],
)
def test_a_mistake_in_an_experiment_is_reported_with_its_line_before_anything_is_written(
    servobench: Command, tmp_path: Path, wrong: str, line: int, said: str
) -> None:
    file = tmp_path / "wrong.toml"
    file.write_text(wrong)

    ended = servobench("run", file, "--out", tmp_path / "run")

    assert ended.status == 2
    assert f"{file}:{line}: " in ended.err
    assert said in ended.err
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("extra", "said"), [('chain = "lowpas 8 Hz"', "lowpass"), ('nominal = "qube"', "qube_servo_2")]
)
def test_a_mistake_in_what_comes_after_the_run_shows_before_it(
    servobench: Command, short: Path, tmp_path: Path, extra: str, said: str
) -> None:
    short.write_text(SHORT.replace("[experiment]", f"[experiment]\n{extra}"))

    ended = servobench("run", short, "--out", tmp_path / "run")

    assert ended.status == 2
    assert said in ended.err
    assert not (tmp_path / "run").exists()


def test_another_device_than_the_file_s_doesn_t_get_its_settings(
    servobench: Command, short: Path, tmp_path: Path
) -> None:
    short.write_text(SHORT + "[device.settings]\nresistance = 9\n")

    ended = servobench("run", short, "--device", "replay", "--out", tmp_path / "run")

    assert ended.status == 2
    assert "--device replay: its setting 'file' is missing: a native file (.mcap)" in ended.err
    assert 'name = "replay" in [device]' in ended.err
    assert str(short) not in ended.err  # nothing in it is wrong
    assert "resistance" not in ended.err


def test_a_device_that_lacks_a_setting_in_a_file_is_reported_with_what_it_is(
    servobench: Command, short: Path, tmp_path: Path
) -> None:
    short.write_text(SHORT + '[device]\nname = "replay"\n')

    ended = servobench("run", short, "--out", tmp_path / "run")

    assert ended.status == 2
    assert "device.settings: its setting 'file' is missing: a native file (.mcap)" in ended.err


@pytest.mark.parametrize("name", DEVICES.names())
@pytest.mark.parametrize("command", [("panel", "--no-open"), ("honest",), ("run",), ("lab", "do", "step")])
def test_whatever_a_named_device_can_t_do_without_is_named(
    servobench: Command, tmp_path: Path, command: tuple[str, ...], name: str
) -> None:
    required = [key for key, field in DEVICES[name].Settings.model_fields.items() if field.is_required()]
    if not required:
        return  # such a device is run by other tests

    ended = servobench(*command, "--device", name)

    assert ended.status == 2
    assert ended.err.count("is missing: ") == len(required)
    assert "give the settings after the name, as key=value, or in" in ended.err
    for key in required:
        assert f"--device {name}: its setting '{key}' is missing: " in ended.err


@pytest.mark.usefixtures("quick_report")
def test_a_chain_of_the_experiment_is_what_its_recording_is_looked_at_through(
    servobench: Command, short: Path, tmp_path: Path
) -> None:
    short.write_text(SHORT.replace("[experiment]", '[experiment]\nchain = "derivative | lowpass 50 rad/s"'))

    result = servobench("run", short, "--out", tmp_path / "run", "--json").result

    assert result["parameters"]["time_constant"]["value"] == pytest.approx(0.0992, rel=0.02)


class Breaking(Twin):
    """A twin that stops answering at a tick."""

    Settings: ClassVar[type[BaseModel]] = Twin.Settings  # type: ignore[assignment]
    last: ClassVar[int] = 1000

    def read(self) -> Sample:
        sample = super().read()
        if sample.index == self.last:
            raise DeviceError("the cable is out")
        return sample


@pytest.fixture
def breaking(monkeypatch: pytest.MonkeyPatch) -> type[Breaking]:
    DEVICES.names()
    monkeypatch.setitem(DEVICES._members, "breaking", Breaking)
    return Breaking


@pytest.mark.usefixtures("breaking")
def test_a_device_that_fails_ends_with_4_and_what_there_is_is_identified(
    servobench: Command, short: Path, tmp_path: Path
) -> None:
    ended = servobench("run", short, "--device", "breaking", "--out", tmp_path / "run")

    assert ended.status == 4
    assert "the cable is out" in ended.err
    assert names(tmp_path / "run") == FILES
    (recording,) = sb.load(tmp_path / "run" / "recording.mcap")
    assert (len(recording["counts"].values), recording.stopped.reason) == (1000, "device_lost")


@pytest.mark.parametrize("last", [0, 1, 2, 5])
def test_a_device_that_fails_at_once_ends_with_4_and_no_traceback(
    servobench: Command,
    short: Path,
    tmp_path: Path,
    breaking: type[Breaking],
    monkeypatch: pytest.MonkeyPatch,
    last: int,
) -> None:
    monkeypatch.setattr(breaking, "last", last)

    ended = servobench("run", short, "--device", "breaking", "--out", tmp_path / "run")

    assert ended.status == 4
    assert "fault of servobench" not in ended.err
    assert {"experiment.toml", "recording.mcap", "data.csv"} <= names(tmp_path / "run")


def test_a_single_sample_is_a_refused_result_with_all_its_files(
    servobench: Command,
    short: Path,
    tmp_path: Path,
    breaking: type[Breaking],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(breaking, "last", 1)

    ended = servobench("run", short, "--device", "breaking", "--out", tmp_path / "run", "--json")

    assert (ended.status, ended.result["verdict"]) == (4, "refused")
    assert ended.result["records"] == []
    assert ended.result["operating_range"] == {"input": [None, None], "speed": [None, None]}
    assert names(tmp_path / "run") == FILES


def watched(monkeypatch: pytest.MonkeyPatch, watch: Callable[[Any], str | None]) -> None:
    """Have every run watched by that function too, before the command's own."""
    import servobench.rig.loop.run as loop

    real = loop.run

    def run(experiment: Any, device: Any, *, watch: Callable[[Any], str | None], **kept: Any) -> Any:
        return real(experiment, device, watch=lambda place: ours(place) or watch(place), **kept)

    ours = watch
    monkeypatch.setattr(loop, "run", run)


@pytest.mark.parametrize("tick", [0, 50, 1200])
def test_ctrl_c_ends_with_130_and_keeps_what_there_is(
    servobench: Command, short: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, tick: int
) -> None:
    def watch(place: Any) -> None:
        if place.tick >= tick:
            raise KeyboardInterrupt

    watched(monkeypatch, watch)

    ended = servobench("run", short, "--out", tmp_path / "run")

    assert ended.status == 130, ended
    (recording,) = sb.load(tmp_path / "run" / "recording.mcap")
    assert recording.stopped.reason == "interrupted"
    assert len(recording["counts"].values) >= tick
    if tick == 1200:
        assert names(tmp_path / "run") == FILES


def test_an_error_after_the_run_loses_nothing(
    servobench: Command, short: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr("servobench.identification.identify.identify_evidence", lambda *_, **__: 1 / 0)

    ended = servobench("run", short, "--out", tmp_path / "run")

    assert ended.status == 1
    assert names(tmp_path / "run") == {"experiment.toml", "recording.mcap", "data.csv"}


def test_a_report_that_can_t_be_written_costs_no_result(
    servobench: Command, short: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def write(*_: object) -> None:
        raise StorageError("no room for the report")

    monkeypatch.setattr("servobench.report.document.Report.write", write)

    ended = servobench("run", short, "--out", tmp_path / "run", "--json")

    assert ended.status == 5
    assert ended.result["verdict"] == "trusted"
    assert "no room for the report" in ended.err
    assert names(tmp_path / "run") == FILES - {"report.html"}


def test_a_run_in_which_the_motor_stands_still_is_refused_with_all_its_files(
    servobench: Command, tmp_path: Path
) -> None:
    file = tmp_path / "still.toml"
    # Friction takes 0.16 V of the twin's: with less the shaft doesn't move.
    file.write_text('[experiment]\nduration = "2 s"\n[signal]\ntype = "constant"\nvalue = "0.1 V"\n')

    ended = servobench("run", file, "--out", tmp_path / "run", "--json")

    assert (ended.status, ended.result["verdict"]) == (3, "refused")
    assert names(tmp_path / "run") == FILES


@pytest.mark.usefixtures("quick_report")
def test_what_is_odd_about_an_experiment_is_said_before_it_runs(
    servobench: Command, short: Path, tmp_path: Path
) -> None:
    short.write_text(SHORT.replace('high = "3 V"', 'high = "30 V"'))

    ended = servobench("run", short, "--out", tmp_path / "run")

    assert ended.out.index("it is clipped at the limit") < ended.out.index("1500 samples")


@pytest.mark.usefixtures("quick_report")
def test_replay_runs_a_recording_again(servobench: Command, finished_run: Path, tmp_path: Path) -> None:
    file = tmp_path / "replay.toml"
    recording = (finished_run / "recording.mcap").as_posix()
    file.write_text(SHORT + f'[device]\nname = "replay"\n[device.settings]\nfile = "{recording}"\n')

    ended = servobench("run", file, "--out", tmp_path / "run", "--json")

    assert ended.status == 0
    assert ended.result["parameters"]["gain"]["value"] == pytest.approx(23.7, rel=0.01)


@pytest.mark.promise("S17")
@pytest.mark.parametrize("request_to_end", ["CTRL_BREAK_EVENT"] if os.name == "nt" else ["SIGINT", "SIGTERM"])
def test_a_run_in_host_time_that_is_ended_from_outside_stops_the_motor_first(
    tmp_path: Path, request_to_end: str
) -> None:
    file = tmp_path / "host.toml"
    file.write_text(HOST)

    with started("run", file, "--out", tmp_path / "run") as child:
        assert child.stderr is not None
        # The line with the time left is the first word after the motor has begun to turn.
        assert any(line.startswith("running, ") for line in child.stderr)
        child.send_signal(getattr(signal, request_to_end))
        out, err = child.communicate(timeout=120)

    assert child.returncode == 130, err
    assert "Traceback" not in err
    assert names(tmp_path / "run") == FILES
    (recording,) = sb.load(tmp_path / "run" / "recording.mcap")
    assert recording.stopped.reason == "interrupted"
    assert {each.code for each in recording.findings} <= {
        "samples-late",
        "samples-missed",
        "real-time",
        "real-time-denied",
        "wake-ups",
    }
    assert f"{len(recording['counts'].values)} samples; " in out
    checked(json.loads((tmp_path / "run" / "result.json").read_text(encoding="utf-8")))


def test_a_wish_that_was_not_reached_is_reported_and_an_empty_one_refused(
    servobench: Command, short: Path, tmp_path: Path
) -> None:
    ended = servobench("run", short, "--until", "gain=0.0000001%", "--out", tmp_path / "a", "--json")

    assert ended.status == 0
    told = [each["sentence"] for each in ended.result["findings"] if each["code"] == "wish-not-reached"]
    assert len(told) == 1
    assert told[0].startswith("The target interval (gain=0.0000001%) was not reached: gain ± 0.")
    assert "ran for 3 s, as asked; the target interval (gain=0.0000001%) was not reached" in ended.err

    empty = servobench("run", short, "--until", "", "--out", tmp_path / "b")
    assert empty.status == 2
    assert "expected, for example, time_constant=0.5%" in empty.err
    assert not (tmp_path / "b").exists()


def test_ctrl_c_while_the_report_is_written_says_where_the_result_is(
    servobench: Command, short: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("servobench.report.document.Report.write", interrupted)
    folder = tmp_path / "run"

    ended = servobench("run", short, "--out", folder)

    assert ended.status == 130
    assert ended.err.endswith(
        f"Error: interrupted before {folder / 'report.html'} was written; the result is complete, and printed\n"
    )
    assert json.loads((folder / "result.json").read_text(encoding="utf-8"))["verdict"] in ended.out
