"""A stand: the motor or the recording that an exercise is done with, and the facts that its studies add."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import servobench as sb
from servobench.core.errors import FormatError, NotIdentifiable, UnknownName, UsageError
from servobench.identification.models.base import STRUCTURES
from servobench.lab.exercise import Exercise, Piece
from servobench.lab.exercise_file import exercises, read_exercise
from servobench.lab.expression import Expression, Fact
from servobench.lab.runs import simulate_run
from servobench.lab.stand import MotorStand, stand_of, stand_on_the_twin, stand_with
from servobench.lab.studies.base import Column, Stand, StudyResult, Table
from servobench.lab.worked_exercise import WorkedExercise
from servobench.rig.experiment.experiment import DeviceChoice

FILE = """+++
title = "Two studies"

[experiment]
duration = "1 s"
nominal = "qube_servo_2"

[signal]
type = "constant"
value = "2 V"

[studies.first]
type = "values"

[[studies.first.rows]]
label = "twice the counts"
answer = "2 * counts_per_rev"

[studies.second]
type = "values"

[[studies.second.rows]]
label = "four times"
answer = "2 * first_value_1"

[[blanks]]
id = "four"
label = "Four times the counts of a turn"
answer = "second_value_1"
tolerance = "exact"

[[corrections]]
where = "nowhere"
paper = "8191"
ours = "{}"
answer = "second_value_1"
why = "It is so. It has been so."
+++

Before.

{{ first }}

Between.
{{second}}
"""


def read(text: str = FILE) -> Exercise:
    return read_exercise(text, "two", "two.md")


def value(text: str, facts: Mapping[str, Fact]) -> float:
    return Expression(text).evaluate(facts).value


def speed_table(stand: Stand) -> StudyResult:
    """A study that runs the exercise's experiment at two levels, and tells the counts at the end."""
    ends = []
    for level in (2.0, 4.0):
        recording = stand.run(stand.experiment.model_copy(update={"signal": sb.Constant(value=level)}))
        ends.append(float(recording["counts"].values[-1]))
    return StudyResult(
        tables=(Table(title="", columns=(Column(name="end", heading="end", values=tuple(ends)),)),)
    )


class Once:
    """A study that counts how often it is carried out."""

    paper: Mapping[str, Any] = {}

    def __init__(self, found: Any) -> None:
        self.found, self.times = found, 0

    def __call__(self, stand: Stand) -> StudyResult:
        self.times += 1
        return self.found(stand)  # type: ignore[no-any-return]


def with_studies(**studies: Any) -> Exercise:
    made = {name: Once(found) for name, found in studies.items()}
    return replace(read(), studies=made, study_lines=dict.fromkeys(made, 12))


def test_a_study_and_a_rule_may_use_what_other_studies_found() -> None:
    facts = stand_on_the_twin(read()).facts

    assert value("second_value_1", facts) == 4 * 2048
    assert value("first_value_1", facts) == 2 * 2048


def test_a_corrections_figure_comes_from_the_studies_that_it_names_and_no_other() -> None:
    [corrected] = WorkedExercise(exercise=read(), stand=stand_on_the_twin(read()), given={}).corrections

    assert (corrected.value, corrected.studies) == (4 * 2048, ("second",))


def test_a_study_is_carried_out_once_and_only_when_it_is_asked_for() -> None:
    found = with_studies(runs=speed_table, other=speed_table)
    stand = stand_with(found, found.experiment.device)

    assert value("runs_end_2 - 2 * runs_end_1 + 0 * runs_end_1", stand.facts) > 0  # friction, taken off twice
    assert (found.studies["runs"].times, found.studies["other"].times) == (1, 0)  # type: ignore[attr-defined]
    assert "runs_end_1" in list(stand.facts)


def test_a_study_runs_the_exercises_own_motor_in_virtual_time() -> None:
    """The dead band of the exercise's motor is there in the runs of its studies, and what a study sets comes on top."""
    asked: list[sb.Recording] = []

    def plain(stand: Stand) -> StudyResult:
        asked.append(stand.run(sb.Experiment(signal=sb.Constant(value=1.0), duration=0.5)))
        other = DeviceChoice(name="twin", settings={"dead_band": 0.0})
        asked.append(stand.run(sb.Experiment(signal=sb.Constant(value=1.0), duration=0.5, device=other)))
        return StudyResult()

    found = with_studies(dead=plain)
    stand_with(found, DeviceChoice(name="twin", settings={"dead_band": 2.0})).study_result("dead")

    still, turning = (np.ptp(recording["counts"].values) for recording in asked)
    assert still == 0
    assert turning > 100
    assert all(recording.info is not None and recording.info.timing == "virtual" for recording in asked)


def test_studies_that_need_each_other_are_a_mistake_with_its_line() -> None:
    text = FILE.replace("2 * counts_per_rev", "second_value_1")

    with pytest.raises(UsageError, match=r"two\.md:12: .*needs its own facts.*first → second → first"):
        stand_on_the_twin(read(text)).study_result("first")


def test_a_mistake_in_a_study_is_reported_with_its_line_and_the_names_that_there_are() -> None:
    text = FILE.replace("2 * first_value_1", "2 * first_valeu_1")

    with pytest.raises(
        UsageError,
        match=r"two\.md:19: the study 'second': no fact called 'first_valeu_1' \(did you mean 'first_value_1'\?\)",
    ):
        stand_on_the_twin(read(text)).study_result("second")


def test_a_study_that_is_not_there_is_reported() -> None:
    with pytest.raises(UnknownName, match="no study called 'frist'"):
        stand_on_the_twin(read()).study_result("frist")


def test_a_recording_alone_tells_what_it_can() -> None:
    found = with_studies(runs=speed_table)
    recording = stand_on_the_twin(read()).recording
    stand = stand_of(found, recording)

    assert value("counts_per_rev", stand.facts) == 2048
    assert stand.recording is recording
    with pytest.raises(NotIdentifiable, match="the study 'runs': this takes further runs of the motor"):
        stand.study_result("runs")


def test_a_recording_that_says_nothing_of_its_device_is_not_enough() -> None:
    recording = replace(stand_on_the_twin(read()).recording, info=None)

    with pytest.raises(UsageError, match=r"doesn't name its device.*expected a recording made by"):
        stand_of(read(), recording)


def test_where_the_recording_tells_nothing_a_misspelt_fact_is_still_reported_as_one() -> None:
    text = FILE.replace('value = "2 V"', 'value = "0.01 V"').replace(
        'duration = "1 s"', 'duration = "1 s"\nchain = "derivative | lowpass 50 rad/s"'
    )
    facts = stand_on_the_twin(read(text)).facts

    for name in ("gain", "chain_lag", "read_gain", "stribeck_voltage", "drag_asymmetry"):
        with pytest.raises(NotIdentifiable, match=f"the recording doesn't determine {name}: "):
            value(name, facts)
    for name in ("gian", "read_gian", "chain_lags"):
        with pytest.raises(UnknownName, match=f"no fact called '{name}'"):
            value(name, facts)


def test_the_data_sheet_is_among_the_facts() -> None:
    """The paper's Table 1, and the algebra of a motor without friction: K = 1/k, τ ≈ R J/k²."""
    facts = stand_on_the_twin(read()).facts

    told = {name: facts[f"sheet_{name}"].value for name in ("resistance", "inductance", "motor_constant")}
    assert told == {"resistance": 8.4, "inductance": 1.16e-3, "motor_constant": 0.042}
    assert value("sheet_inertia", facts) == pytest.approx(
        4.0e-6 + 0.5 * 0.0106 * 0.0111**2 + 0.5 * 0.053 * 0.0248**2, rel=1e-12
    )
    assert value("sheet_rotor_inertia + sheet_hub_inertia + sheet_disc_inertia - sheet_inertia", facts) == 0
    assert value("sheet_gain", facts) == pytest.approx(1 / 0.042, rel=1e-12)
    inertia = value("sheet_inertia", facts)
    slow = np.roots([1.16e-3 * inertia, 8.4 * inertia, 0.042**2]).max()
    assert value("sheet_time_constant", facts) == pytest.approx(-1 / slow, rel=1e-9)


def test_without_a_data_sheet_there_are_none_of_its_facts() -> None:
    facts = stand_on_the_twin(read(FILE.replace('nominal = "qube_servo_2"\n', ""))).facts

    assert "sheet_gain" not in facts


def test_what_begins_like_a_fact_can_not_be_a_studys_name() -> None:
    """Held against the parameters of all structures, and the facts of an exercise's evidence."""
    parameters = {p.name for name in STRUCTURES.names() for p in STRUCTURES[name].parameters}
    told = set(stand_on_the_twin(replace(read(), studies={})).facts)
    first_words = {name.partition("_")[0] for name in parameters | told if "_" in name}

    for word in sorted(first_words):
        with pytest.raises(FormatError, match=rf"two\.md:12: a study can't be called '{word}'"):
            read(FILE.replace("studies.first", f"studies.{word}").replace("{{ first }}", f"{{{{ {word} }}}}"))


def test_the_text_is_cut_where_studies_stand() -> None:
    assert read().pieces == (
        Piece(text="Before.\n\n"),
        Piece(study="first"),
        Piece(text="\nBetween.\n"),
        Piece(study="second"),
    )


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("{{ first }}", "{{ frist }}", r"two\.md:42: no study called 'frist' \(did you mean 'first'\?\)"),
        ("{{ first }}", "{{ }}", r"two\.md:42: no study called ''"),
        ("{{ first }}", "Here: {{ first }}", r"two\.md:42: .*on a line of its own"),
        ("{{second}}", "{{ first }}", r"two\.md:45: the study 'first' stands in line 42 already"),
    ],
)
def test_a_place_for_no_study_is_reported_with_its_line(old: str, new: str, said: str) -> None:
    with pytest.raises(FormatError, match=said):
        read(FILE.replace(old, new))


def test_lines_of_studies_and_corrections_are_known() -> None:
    found = read()

    assert found.place_of_study("second") == "two.md:19"
    assert found.place_of_correction(found.corrections[0]) == "two.md:32"


def test_who_stops_a_run_is_not_given_the_next_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ctrl-C in a run is a result of that run; the exercise ends with it."""
    from servobench.recordings.recording import Stopped
    from servobench.rig.loop import live

    stand = stand_with(read(), read().experiment.device)
    stopped = Stopped(reason="interrupted", sentence="stopped by the keyboard")
    cut = replace(stand.recording, stopped=stopped)
    monkeypatch.setattr(live, "run_where_its_time_passes", lambda *_: cut)

    with pytest.raises(KeyboardInterrupt, match="stopped by the keyboard"):
        stand.run(stand.experiment)


@pytest.mark.parametrize("found", exercises(), ids=lambda e: e.name)
def test_all_studies_and_corrections_of_an_exercise_have_their_figures(found: Exercise) -> None:
    stand: MotorStand = stand_on_the_twin(found)

    for name in found.studies:
        shown = stand.study_result(name)
        assert shown.tables or shown.figures or shown.facts, name
    for correction in found.corrections:
        if correction.answer:
            assert math.isfinite(value(correction.answer, stand.facts)), correction.where


def test_a_run_beside_the_exercises_own_takes_its_own_settings_before_the_experiments() -> None:
    asked = read().experiment
    device = DeviceChoice(
        name="twin", settings={"counts_per_rev": 500, "coulomb_torque": 0.0, "timing": "host"}
    )
    found = simulate_run(asked.model_copy(update={"device": device, "duration": 0.1}), counts_per_rev=4096)

    assert found["counts"].channel.counts_per_rev == 4096
    assert found.info is not None
    assert dict(found.info.settings)["coulomb_torque"] == "0.0"
    assert found.info.timing == "virtual"  # whatever the experiment says: nobody waits for a run beside
