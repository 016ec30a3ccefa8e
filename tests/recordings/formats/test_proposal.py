"""A proposed mapping: what is recognised is set, what isn't is a question, and the file reads back."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from servobench.core.channels import Channel
from servobench.core.errors import MissingInformation
from servobench.recordings.formats.mapping import Mapping
from servobench.recordings.formats.proposal import proposal
from servobench.recordings.recording import Recording, Series, Source

T = 0.01 * np.arange(40)


def made(name: str = "run", t: np.ndarray | None = T, **units: str | None) -> Recording:
    series = tuple(
        Series(channel=Channel(name=each.replace("__", " "), unit=unit), values=np.sin(9 * T + k), t=t)
        for k, (each, unit) in enumerate(units.items())
    )
    return Recording(name=name, series=series, source=Source(name="made.csv", format="csv"))


def read(text: str, tmp_path: Path) -> Mapping:
    file = tmp_path / "map.toml"
    file.write_text(text, encoding="utf-8")
    return Mapping.read(file)


def test_what_is_recognised_is_set_and_assigns_what_would_have_been_assigned(tmp_path: Path) -> None:
    recording = made(u="V", theta="deg", temperature=None)

    mapping = read(proposal([recording]), tmp_path)

    assert (mapping.input, mapping.output) == ("u:V", "theta:deg")
    assigned = mapping.assign_to(recording)
    assert (assigned.input, assigned.output) == ("u", "theta")


def test_what_is_unknown_is_a_comment_that_needs_no_more_than_its_mark_taken_away(tmp_path: Path) -> None:
    recording = made(left="V", right="V", wheel="rad", goal="deg", vbat="V")
    text = proposal([recording])

    with pytest.raises(MissingInformation):
        read(text, tmp_path).assign_to(recording)
    for line in ('# input = "left:V"', '# output = "wheel:rad"'):
        assert f"\n{line}\n" in text
        text = text.replace(line, line.removeprefix("# "))

    assert read(text, tmp_path).assign_to(recording).input == "left"
    assert '\n# reference = "goal:deg"\n' in text
    assert '\n# supply = "vbat:V"\n' in text


def test_a_speed_is_asked_how_it_was_measured_and_a_known_chain_is_set(tmp_path: Path) -> None:
    recording = made(u="V", speed="rad/s")

    assert "How was this speed measured?" in proposal([recording]).replace("\n# ", " ")

    known = replace(recording, chain="derivative | lowpass 50 rad/s")
    assert read(proposal([known]), tmp_path).chain == known.chain


def test_samples_without_times_are_asked_for_them(tmp_path: Path) -> None:
    recording = made(t=None, u="V", speed="rad/s")
    text = proposal([recording])

    assert '\n# time = "COL:s"\n' in text
    edited = text.replace('# sample_time = "SECONDS"', 'sample_time = "20 ms"')
    assert read(edited, tmp_path).assign_to(recording)["u"].t == pytest.approx(0.02 * np.arange(40))


def test_recordings_that_are_alike_have_one_mapping_and_a_list_to_choose_from(tmp_path: Path) -> None:
    several = [made("slow", u="V", theta="rad"), made("fast", u="V", theta="rad")]

    mapping = read(proposal(several), tmp_path)

    assert mapping.recordings == ("slow", "fast")
    assert mapping.each == {}


def test_recordings_that_differ_have_a_table_each(tmp_path: Path) -> None:
    several = [made("a", u="V", theta="rad"), made('b "2"', u="V", omega="rpm")]

    mapping = read(proposal(several), tmp_path)

    assert mapping.of("a").output == "theta:rad"
    assert mapping.of('b "2"').output == "omega:rpm"
    assert [mapping.assign_to(each).output for each in several] == ["theta", "omega"]


def test_a_recording_is_proposed_as_it_knows_itself(tmp_path: Path) -> None:
    recording = replace(made(a="V", b="counts/s", c="rad"), input="a", output="b")

    mapping = read(proposal([recording]), tmp_path)

    assigned = mapping.assign_to(recording)
    assert (assigned.input, assigned.output) == (recording.input, recording.output)


def test_names_from_a_hostile_file_stay_comments_and_texts(tmp_path: Path) -> None:
    evil = made(u="V", **{'y\n"] = 1\n[x': None})
    several = [replace(evil, name='r\n[input]\nx = "1"'), made("b", u="V")]

    text = proposal(several)

    assert read(text, tmp_path).recordings == tuple(each.name for each in several)
    assert not re.search(r"^\[x", text, re.MULTILINE)


def test_the_voltage_of_a_supply_is_never_taken_for_the_motors_own(tmp_path: Path) -> None:
    servo = made(timestamp=None, load=None, input_volts="V", position="rad")

    text = proposal([servo])

    assert read(text, tmp_path).input is None
    assert '\n# supply = "input_volts:V"\n' in text
    assert '\n# time = "timestamp:s"\n' in proposal([made(t=None, timestamp=None, load=None, position="rad")])
