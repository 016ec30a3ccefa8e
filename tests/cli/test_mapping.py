"""From a file that isn't understood to a result by way of a mapping: proposed, edited as a person would, used."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import servobench as sb
from tests.cli.conftest import Command


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """A motor of 20 rad/(s·V) and 0.1 s under a square wave of duty, its speed and its supply, with names that say little."""
    t = 0.01 * np.arange(600)
    duty = np.where(t % 2.0 < 1.0, 0.6, 0.2)
    supply = 8.0 - 0.5 * duty
    volts = duty * supply
    speed = np.zeros(600)
    for k in range(599):  # exact for a voltage that holds
        speed[k + 1] = 20.0 * volts[k] + (speed[k] - 20.0 * volts[k]) * np.exp(-0.01 / 0.1)
    speed += 0.05 * np.random.default_rng(8).standard_normal(600)
    file = tmp_path / "log.csv"
    table = np.column_stack([t, 885 * duty, supply, speed])
    np.savetxt(file, table, delimiter=",", header="t,load,batt,wheel", comments="", fmt="%.9g")
    return file


def test_a_mapping_is_proposed_edited_and_used(servobench: Command, log: Path, tmp_path: Path) -> None:
    target = tmp_path / "map.toml"

    proposed = servobench("inspect", log, "--write-mapping", target)

    assert (proposed.status, proposed.err) == (0, "")
    assert servobench("identify", log, "--mapping", target).status == 2
    text = target.read_text(encoding="utf-8")
    for line, edited in (
        ('# input = "COL:UNIT"', 'input = "load:PWM/885"'),
        ('# output = "COL:UNIT"', 'output = "wheel:rad/s"'),
        ('# supply = "batt:UNIT"', 'supply = "batt:V"'),
        ('# chain = "none"', 'chain = "none"'),
    ):
        assert line in text
        text = text.replace(line, edited)
    target.write_text(text, encoding="utf-8")

    ended = servobench("identify", log, "--mapping", target, "--json")

    assert ended.status == 0
    low, high = ended.result["parameters"]["gain"]["interval"]
    assert low < 20.0 < high
    low, high = ended.result["parameters"]["time_constant"]["interval"]
    assert low < 0.1 < high
    assert "supply-applied" in {each["code"] for each in ended.result["findings"]}


def test_options_come_before_the_mapping(servobench: Command, log: Path, tmp_path: Path) -> None:
    target = tmp_path / "map.toml"
    target.write_text('input = "load:PWM/885"\nsupply = "batt:V"\noutput = "batt:V"\n')

    ended = servobench("identify", log, "--mapping", target, "--output", "wheel:rad/s", "--json")

    assert ended.status == 0


def test_convert_writes_what_the_mapping_says(servobench: Command, log: Path, tmp_path: Path) -> None:
    target = tmp_path / "map.toml"
    target.write_text('input = "load:PWM/885"\nsupply = "8 V"\noutput = "wheel:rpm"\nchain = "talon-srx"\n')

    ended = servobench("convert", log, tmp_path / "known.mcap", "--mapping", target)

    assert (ended.status, ended.err) == (0, "")
    (recording,) = sb.load(tmp_path / "known.mcap")
    assert (recording.input, recording.output, recording.chain) == ("motor_voltage", "wheel", "talon-srx")
    assert recording["wheel"].channel.unit == "rpm"
    assert recording["motor_voltage"].values.max() == pytest.approx(0.6 * 8.0)


def test_convert_refuses_a_chain_that_is_still_to_come(
    servobench: Command, log: Path, tmp_path: Path
) -> None:
    target = tmp_path / "map.toml"
    target.write_text('input = "load:%"\noutput = "wheel:rad"\nchain = "derivative"\n')

    ended = servobench("convert", log, tmp_path / "known.mcap", "--mapping", target)

    assert ended.status == 2
    assert "hasn't passed the chain `derivative` yet" in ended.err


def test_nothing_is_overwritten_unasked(servobench: Command, log: Path, tmp_path: Path) -> None:
    target = tmp_path / "map.toml"
    target.write_text("mine")

    ended = servobench("inspect", log, "--write-mapping", target)

    assert ended.status == 2
    assert "--overwrite" in ended.err
    assert target.read_text() == "mine"
    assert servobench("inspect", log, "--write-mapping", log, "--overwrite").status == 2
    assert servobench("inspect", log, "--write-mapping", target, "--overwrite").status == 0
    both = servobench("inspect", log, "--write-mapping", target, "--report", target, "--overwrite")
    assert both.status == 2
    assert "both name" in both.err
    assert target.read_text() != "mine"


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ('inputs = "u:V"\n', "did you mean 'input'"),
        ("input = 3\n", "input is 3; expected a text such as"),
        ('recordings = "a"\n', "recordings is 'a'; expected a list of names"),
        ('recording = "a"\n', "expected tables such as"),
        ('[recording.log]\noutptu = "y"\n', "did you mean 'output'"),
        ('[recording.other]\noutput = "wheel:rad/s"\n', "no recording called 'other'"),
        ("sample_time = 0\n", "sample_time: the sample time is 0"),
        ('chain = "talon"\n', "did you mean 'talon-srx'"),
        ("input = \n", "map.toml can't be read"),
    ],
)
def test_a_mistake_in_a_mapping_names_the_file_the_key_and_what_was_expected(
    servobench: Command, log: Path, tmp_path: Path, text: str, why: str
) -> None:
    target = tmp_path / "map.toml"
    target.write_text(text)
    said = ["--input", "load:%", "--output", "wheel:rad/s"] if text.startswith("chain") else []

    ended = servobench("identify", log, "--mapping", target, *said)

    assert ended.status == 2
    assert why in ended.err


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (("--output", "wheel:furlong"), "'furlong' isn't a known unit"),
        (("--output", "wheel:rads/s"), "did you mean rad/s"),
        (("--output", "t"), "`t` holds the times; the output is what was measured on the motor"),
        (("--output", "t:rad"), "`t` holds the times"),
    ],
)
def test_a_unit_that_is_not_known_and_a_time_as_output_are_reported_as_what_they_are(
    servobench: Command, log: Path, words: tuple[str, ...], why: str
) -> None:
    ended = servobench("identify", log, "--input", "load:%", *words)

    assert ended.status == 2
    assert why in ended.err


def test_a_chain_of_none_is_an_answer(servobench: Command, log: Path) -> None:
    words = ("identify", log, "--input", "load:%", "--output", "wheel:rad/s", "--json")

    without, said = servobench(*words).result, servobench(*words, "--chain", "none").result

    values = [{name: each["value"] for name, each in r["parameters"].items()} for r in (without, said)]
    assert values[0] == values[1]
    assert without["parameters"]["gain"] == said["parameters"]["gain"]
    # Unless somebody says that nothing lies between, the delay may have half a sample of differencing in it.
    spread = [result["parameters"]["delay"]["sd"] for result in (without, said)]
    assert spread[0] == pytest.approx(math.hypot(spread[1], 0.5 * 0.01 / math.sqrt(3.0)), rel=1e-3)


def test_w_in_its_unit_need_not_be_asked_for(servobench: Command, log: Path) -> None:
    log.write_text(log.read_text().replace("t,load,batt,wheel", "t,u,i_A,w[rad/s]"))

    said = servobench("inspect", log).out

    assert "the output is a speed in rad/s" in said


def test_inspect_draws_in_ascii_where_nothing_else_can_be_encoded(log: Path) -> None:
    from tests.cli.conftest import process

    ended = process("inspect", log, PYTHONIOENCODING="ascii")

    assert ended.status == 0
    assert "*****" in ended.out
    assert ended.out.isascii()


@pytest.mark.parametrize(
    ("name", "edits"),
    [
        ("undcmotor/und_DCmotor_prbs_open_exp.csv", {'# output = "y:UNIT"': 'output = "y:deg/s"'}),
        (
            "emps/DATA_EMPS.mat",
            {'# input = "COL:UNIT"': 'input = "vir:V"', '# output = "COL:UNIT"': 'output = "qm:m"'},
        ),
        (
            "gkeiel_pot_servo/gk_pid.csv",
            {
                '# input = "COL:UNIT"': 'input = "2:V"',
                '# output = "COL:UNIT"': 'output = "3:deg"',
                '# sample_time = "SECONDS"': 'sample_time = "20 ms"',
            },
        ),
    ],
)
def test_files_of_others_are_proposed_edited_and_identified(
    servobench: Command, tmp_path: Path, real_data: Callable[[str], Path], name: str, edits: dict[str, str]
) -> None:
    file, target = real_data(name), tmp_path / "map.toml"
    assert servobench("inspect", file, "--write-mapping", target).status == 0
    text = target.read_text(encoding="utf-8")
    for question, answer in edits.items():
        assert question in text
        text = text.replace(question, answer)
    target.write_text(text, encoding="utf-8")

    ended = servobench("identify", file, "--mapping", target, "--json")

    assert ended.status in (0, 3)
    assert ended.result["records"]
