"""An argument has its Python keyword in messages to scripts, its option on the command line, its field in the panel."""

import inspect
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer.main

from servobench.cli.app import app
from servobench.cli.option_names import OPTIONS, TUNE, with_options
from servobench.core.errors import MissingInformation
from servobench.export.base import TARGETS, Wishes
from servobench.panel.field_names import with_fields
from servobench.recordings.formats.base import load
from servobench.recordings.formats.mapping import assign
from servobench.recordings.measurement.measure import measure
from servobench.systems.tuning.base import Wish
from tests.cli.conftest import Command


def options(command: Any) -> Iterator[str]:
    for parameter in command.params:
        yield from parameter.opts
    for inner in getattr(command, "commands", {}).values():
        yield from options(inner)


def test_each_keyword_has_an_option_that_some_command_takes() -> None:
    assert set(OPTIONS.values()) | set(TUNE.values()) <= set(options(typer.main.get_command(app)))


def test_the_keywords_of_columns_exports_and_tuning_are_pythons_own() -> None:
    for taken in (inspect.signature(assign).parameters, Wishes.__dataclass_fields__):
        assert {name for name in taken if name != "recording"} <= set(OPTIONS)
    for name in ("damping", "bandwidth", "poles", "closed_loop", "sample_time"):
        assert name in Wish.__dataclass_fields__
        assert TUNE[name] != OPTIONS.get(name) or name in ("damping", "bandwidth", "poles")


def test_a_value_is_kept_and_a_missing_one_left_out() -> None:
    said = "say, for example, `sample_time=0.02` (in s), or `time=COL[:UNIT]`; `chain=...` says the filter, `u=V` nothing"

    assert with_options(said) == (
        "say, for example, --sample-time 0.02 (in s), or --time COL[:UNIT]; --chain says the filter, `u=V` nothing"
    )
    assert with_fields(said) == (
        "say, for example, the field “Time between two samples” (0.02) (in s), or the field “time”; "
        "the field “chain” says the filter, "
        "`u=V` nothing"
    )


def test_python_is_reported_its_keyword_and_the_terminal_its_option(
    servobench: Command, tmp_path: Path
) -> None:
    file = tmp_path / "no_times.csv"
    file.write_text("u,y\n" + "".join(f"{n % 3},{n}\n" for n in range(50)), encoding="utf-8")

    with pytest.raises(MissingInformation) as error:
        measure(assign(load(file)[0], input="u:V", output="y:rad"))
    assert "`sample_time=" in str(error.value)
    assert "--" not in str(error.value)
    said = servobench("identify", file, "--input", "u:V", "--output", "y:rad")
    assert said.status == 2
    assert "--sample-time SECONDS" in said.err
    assert "sample_time=" not in said.err


def test_tune_and_design_ask_by_their_own_options_for_what_a_recording_does_not_say(
    servobench: Command, tmp_path: Path
) -> None:
    file = tmp_path / "motor.csv"
    file.write_text("time,a,b\n" + "".join(f"{n / 100},{n % 3},{n}\n" for n in range(50)), encoding="utf-8")

    for command in (
        ("tune", file, "--damping", "0.8", "--bandwidth", "20"),
        ("design", "--from", file, "--voltage-limit", "10", "--duration", "10"),
    ):
        said = servobench(*command)
        assert said.status == 2
        assert "--input" in said.err
        assert "--output" in said.err


def test_tune_calls_the_closed_loops_time_constant_lambda(servobench: Command, finished_run: Path) -> None:
    said = servobench("tune", finished_run, "--method", "lambda_tuning", "--damping", "0.8")

    assert said.status == 2
    assert "give --lambda, such as --lambda 50ms" in said.err
    assert "closed_loop" not in said.err


def test_no_two_targets_write_the_same_file_by_default() -> None:
    from servobench.cli.export import default_name

    names = [default_name(target) for target in TARGETS.names()]

    assert len(set(names)) == len(names)
    assert default_name("json") == "motor.json"
    assert default_name("wpilib") == "motor-wpilib.json"
