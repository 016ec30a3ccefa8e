"""Faults that are injected on purpose: by an experiment's file, by `--fault`, and what is said of them."""

import json
from pathlib import Path

import pytest

from servobench.core.errors import UsageError
from servobench.recordings.native.reader import read
from servobench.rig.devices.faults.base import FAULTS, table_of
from servobench.rig.experiment import load_experiment, read_experiment
from tests.cli.conftest import Command

SHORT = """
[experiment]
duration = "3 s"
sample_time = "2 ms"
[signal]
type = "square"
low = "1 V"
high = "3 V"
frequency = "0.4 Hz"
[device]
name = "twin"
"""
STALE = """
[[device.faults]]
name = "stale"
from = "1 s"
every = 100
"""


@pytest.fixture
def quick_report(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("servobench.report.document.Report.html", lambda _: "<!doctype html>")


def test_all_faults_and_all_their_settings_are_listed(servobench: Command) -> None:
    said = servobench("faults").out

    for name in FAULTS.names():
        assert f"{name}  " in said
        for key, field in FAULTS[name].model_fields.items():
            assert (field.alias or key) in said
    assert "from_" not in said
    assert "stuck_channel" in servobench("faults", "stuck_channel").out


def test_an_unknown_fault_is_refused_with_the_known_ones(servobench: Command) -> None:
    done = servobench("faults", "stuck_chanel")

    assert done.status == 2
    assert "did you mean 'stuck_channel'" in done.err


@pytest.mark.promise("S40")
@pytest.mark.usefixtures("quick_report")
def test_a_run_with_faults_from_its_file_and_the_line_says_so_everywhere(
    servobench: Command, tmp_path: Path
) -> None:
    (tmp_path / "a.toml").write_text(SHORT + STALE)
    done = servobench(
        "run", tmp_path / "a.toml", "--fault", "lost every=200", "--fault", "nan probability=0.001",
        "--out", tmp_path / "run", "--json",
    )  # fmt: skip

    assert done.status == 0
    told = "stale from=1s every=100; lost every=200; nan probability=0.001"
    result = json.loads((tmp_path / "run" / "result.json").read_text(encoding="utf-8"))
    (finding,) = [finding for finding in result["findings"] if finding["code"] == "faults-injected"]
    assert told in finding["sentence"]
    assert result["verdict"] == "doubtful"
    (recording,) = read(tmp_path / "run" / "recording.mcap")
    assert recording.info is not None
    assert dict(recording.info.settings)["faults"] == told
    again = load_experiment(tmp_path / "run" / "experiment.toml")
    assert [table["name"] for table in again.device.faults] == ["stale", "lost", "nan"]
    assert read_experiment(again.to_toml()) == again
    assert recording.experiment == again.to_toml()


@pytest.mark.parametrize(
    ("text", "place", "said"),
    [
        (STALE.replace("stale", "stail"), "a.toml:14", "no fault called 'stail' (did you mean 'stale'?)"),
        (STALE.replace("every", "evry"), "a.toml:16", "not known here (did you mean 'every'?)"),
        (STALE.replace('"1 s"', '"1 V"'), "a.toml:15", "device.faults[0].from"),
        (STALE + STALE.replace("100", "0"), "a.toml:21", "device.faults[1].every"),
        (STALE.replace('name = "stale"\n', ""), "a.toml:13", "has no name"),
        (
            STALE.replace("every = 100", "every = 100\nprobability = 0.1"),
            "a.toml:13",
            "leave one of them out",
        ),
    ],
)
def test_a_mistake_in_a_fault_is_reported_with_its_line_before_anything_moves(
    servobench: Command, tmp_path: Path, text: str, place: str, said: str
) -> None:
    (tmp_path / "a.toml").write_text(SHORT + text)
    done = servobench("run", tmp_path / "a.toml", "--out", tmp_path / "run")

    assert done.status == 2
    assert place in done.err
    assert said in " ".join(done.err.split())
    assert not (tmp_path / "run").exists()


@pytest.mark.promise("S41")
@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("stail every=2", "no fault called 'stail' (did you mean 'stale'?)"),
        ("nan channel=tachometer", "can't have the fault 'nan': it has no channel 'tachometer'"),
        ("lost", "lose every sample"),
    ],
)
def test_a_fault_that_can_not_be_had_is_refused_before_anything_moves(
    servobench: Command, tmp_path: Path, text: str, said: str
) -> None:
    done = servobench("run", "--fault", text, "--out", tmp_path / "run")

    assert done.status == 2
    assert said in " ".join(done.err.split())
    assert not (tmp_path / "run").exists()


@pytest.mark.promise("S39")
def test_without_faults_a_file_says_nothing_of_them() -> None:
    assert "faults" not in read_experiment(SHORT).to_toml()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "the fault '' can't be read (it is empty)"),
        ("lost 'from", "(a quotation mark isn't closed)"),
        ("lost from=1s", "the fault 'lost from=1s': would lose every sample"),
        ("lost probability=2", "probability: expected less than or equal to 1"),
    ],
)
def test_a_fault_that_can_not_be_read_is_reported_in_our_words(text: str, said: str) -> None:
    with pytest.raises(UsageError) as caught:
        table_of(text)
    assert said in str(caught.value)
    assert "Input should" not in str(caught.value)


def test_a_data_sheet_that_there_is_not_is_reported_with_its_line(
    servobench: Command, tmp_path: Path
) -> None:
    file = tmp_path / "short.toml"
    file.write_text(SHORT + '[limits.plausibility]\nmotor = "cube"\n')

    ended = servobench("run", file, "--out", tmp_path / "run")

    assert ended.status == 2
    line = file.read_text().splitlines().index('motor = "cube"') + 1
    assert f"short.toml:{line}: limits.plausibility.motor: no " in ended.err
    assert not (tmp_path / "run").exists()
