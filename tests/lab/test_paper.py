"""The paper from end to end: each place where it errs is corrected here, and what it contains stands in an exercise.

This is the list, so that none is lost. Figures are held against algebra alone; the tests of the exercises hold runs more closely.
"""

import math
import re
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

from servobench.lab.exercise import Correction, Exercise
from servobench.lab.exercise_file import exercises
from servobench.lab.stand import stand_on_the_twin
from servobench.lab.worked_exercise import EvaluatedCorrection, WorkedExercise

# Table 1 of the paper.
R, K, L, ROTOR = 8.4, 0.042, 1.16e-3, 4.0e-6
HUB, DISC = 0.5 * 0.0106 * 0.0111**2, 0.5 * 0.053 * 0.0248**2
J = ROTOR + HUB + DISC
COUNT = 2 * math.pi / 2048
FRICTION = 8e-4 * R / K  # V, the simulated motor's


def _slow_and_fast() -> tuple[float, float]:
    """The time constants of L J s² + R J s + k² [s]."""
    root = math.sqrt((R * J) ** 2 - 4 * L * J * K * K)
    return 2 * L * J / (R * J - root), 2 * L * J / (R * J + root)


def _noise(speed: float, sample_time: float) -> float:
    """The rms of the differenced counts at a constant speed [rad/s]: (Δ/T) √(f (1 - f))."""
    fraction = speed * sample_time / COUNT % 1
    return COUNT / sample_time * math.sqrt(fraction * (1 - fraction))


def _behind_the_filter(tau: float, cutoff: float) -> float:
    """When a first-order motor behind a first-order filter has gone 63.2 % of its way [s]."""
    low, high = 0.0, 1.0
    for _ in range(60):
        t = 0.5 * (low + high)
        left = (tau * math.exp(-t / tau) - math.exp(-t * cutoff) / cutoff) / (tau - 1 / cutoff)
        low, high = (t, high) if left > math.exp(-1) else (low, t)
    return low


def _noise_over_all_speeds(sample_time: float) -> float:
    """The same over all speeds up to 400 rad/s [rad/s], from a constant speed on that takes 13 counts a sample."""
    speeds = np.linspace(20.0, 400.0, 100_001)
    return math.sqrt(np.mean([_noise(speed, sample_time) ** 2 for speed in speeds]))


def _sampled_and_filtered(tau: float) -> float:
    """The same behind differences of two samples and the filter by Tustin, sample by sample, without rounding [s]."""
    t = 0.002 * np.arange(500)
    speed = np.diff(t - tau * -np.expm1(-t / tau), prepend=0.0) / 0.002
    above, below, _ = cont2discrete(([50.0], [1.0, 50.0]), 0.002, "bilinear")
    return float(np.interp(1 - math.exp(-1), lfilter(above[0], below, speed), t))


@dataclass(frozen=True)
class Place:
    """A place where the paper errs: the exercise, how the place is called, what the paper has there, and what is right."""

    exercise: str
    where: str
    paper: str
    right: float | None = None
    within: float = 5e-3  # relative; half of the last of the paper's three digits, where nothing is derived


_, FAST = _slow_and_fast()
PLACES = {
    "1 eq. 7": Place("modelling", "eq. 7", "V = R I + k I", K / ((R + K) * (HUB + DISC))),
    "2 J_eq": Place("modelling", "J_eq", "hub and disc", R * J / K**2),
    "2 0.13 s is never derived": Place("modelling", "II.E, τ", "never derived", R * J / K**2, 0.01),  # b makes it 0.5 % less
    "2 K is never reported": Place("modelling", "eq. 10, K", "never given a number", 1 / K, 0.01),  # as above
    # Sampled every 2 ms, so that the difference is late by 1 ms. The data sheet's slow pole is 0.14 ms less than R J/k².
    "3 63.2 % behind the filter": Place("step", "0.13 s", "0.13 s", _sampled_and_filtered(R * J / K**2), 2e-3),
    "3 the same, measured": Place("identification", "II.E, τ = 0.13 s", "0.13 s", _behind_the_filter(R * J / K**2, 50.0), 0.02),
    "4 the sign of the pole": Place("stability", "poles", "-7.69", -(K**2) / (R * J), 0.01),  # b, as above
    "5 -3 dB": Place("filter", "II.D", "50 %", 100 / math.sqrt(2)),
    "6 table 1-4": Place("filter", "Table 1-4", "0.006 s", 1 / 150),
    "6 the encoder's gain": Place("encoder", "gain of the encoder", "0.175778125", 360 / 2048, 1e-9),
    "7 a zero-mean sinusoid": Place("stability", "sinusoid", "unstable"),
    "7 a pulse that settles": Place("stability", "pulse", "stable"),
    "8 Euler with L": Place("sampling", "II.A", "0.002 s", 1 - 0.002 / FAST),
    "9 the noise depends on the speed": Place("speed", "Figure 1-16", "random", _noise(47.6, 0.001) / _noise(47.6, 0.002)),
    "10 the dead band": Place("driving", "0.5 V", "0.5 V", 0.65 + FRICTION, 1e-9),
    "11 resistance for 0.13 s": Place("identification", "the motor's own", "8.4", 0.13 * K**2 / J),
    "11 inertia for 0.13 s": Place("identification", "inertia", "0.13 s", 1e6 * 0.13 * K**2 / R),
    "13 the cut-off": Place("filter", "II.D, the cut-off", "V_o/V_i", 50 / (2 * math.pi), 1e-9),
    # The mean of f (1 - f) over all fractions f is 1/6.
    "14 the code disc": Place("speed", "the code disc", "linearity", _noise_over_all_speeds(0.002), 2e-3),
    "15 the stall monitor": Place("driving", "stall monitor", "glitch", 3.0, 1e-3),
    # θ = ω (t - τ) at the end, 2.502 s; the counter is within a count of 48 rad, and b makes τ 0.5 % less.
    "16 speed and position": Place("stability", "speed and position", "proportional", 2.502 - R * J / K**2, 1e-3),
    "17 both approaches": Place("stability", "both approaches", "similar"),
    "12 the filter's factor": Place("filter", "I.D", "1/(s + 1/τ)", abs(1 / (0j + 1 / 0.02))),
}  # fmt: skip


@cache
def lab() -> dict[str, Exercise]:
    return {each.name: each for each in exercises()}


@cache
def worked_out(name: str) -> tuple[EvaluatedCorrection, ...]:
    exercise = lab()[name]
    return WorkedExercise(exercise=exercise, stand=stand_on_the_twin(exercise), given={}).corrections


def corrections(place: Place) -> list[Correction]:
    found = lab()[place.exercise].corrections
    return [each for each in found if place.where in each.where and place.paper in each.paper]


@pytest.mark.parametrize("name", PLACES)
def test_each_place_where_the_paper_errs_is_corrected(name: str) -> None:
    found = corrections(PLACES[name])

    assert found, f"{name}: no correction left in {PLACES[name].exercise}.md"
    assert all(each.why and each.ours for each in found)


@pytest.mark.parametrize("name", [name for name, place in PLACES.items() if place.right is not None])
def test_the_figure_beside_the_papers_is_right(name: str) -> None:
    place = PLACES[name]
    told = [each for each in worked_out(place.exercise) if each.correction in corrections(place)]

    assert place.right is not None
    assert any(each.value == pytest.approx(place.right, rel=place.within) for each in told), told


def test_no_place_is_claimed_twice_by_the_same_correction() -> None:
    """Two places that the same correction answers would hide that one of the two is lost."""
    first = [(name, corrections(place)[0].where, place.exercise) for name, place in PLACES.items()]
    seen = {(exercise, where) for _, where, exercise in first}

    assert len(seen) == len(first), first


# What the paper contains: the exercise in which that number of the paper stands beside ours.
NUMBERS = {
    "Table 1, R": ("modelling", 8.4),
    "Table 1, k": ("modelling", 0.042),
    "Table 1, rotor": ("modelling", 4.0e-6),
    "Table 1, L [mH]": ("modelling", 1.16),
    "Table 1, hub, mass": ("modelling", 0.0106),
    "Table 1, hub, radius": ("modelling", 0.0111),
    "Table 1, disc, mass": ("modelling", 0.053),
    "Table 1, disc, radius": ("modelling", 0.0248),
    "encoder, counts": ("encoder", 2048),
    "encoder, degrees": ("encoder", 0.175778125),
    "encoder, radians": ("encoder", 0.003068),
    "II.D, cut-off in Hz": ("filter", 7.96),
    "Table 1-4, 10 rad/s": ("filter", 0.1),
    "Table 1-4, 20 rad/s": ("filter", 0.05),
    "Table 1-4, 50 rad/s": ("filter", 0.02),
    "Table 1-4, 100 rad/s": ("filter", 0.01),
    "Table 1-4, 150 rad/s": ("filter", 0.006),
    "Table 1-4, 200 rad/s": ("filter", 0.005),
    "II.D, -3 dB [%]": ("filter", 50),
    "II.E, time constant": ("step", 0.13),
    "II.E, pole": ("stability", -7.6923),
}


@pytest.mark.parametrize("name", NUMBERS)
def test_each_number_of_the_paper_stands_beside_ours(name: str) -> None:
    exercise, number = NUMBERS[name]

    assert number in _papers(lab()[exercise])


@pytest.mark.parametrize("verdict", ["stable", "marginally stable", "unstable"])
def test_the_papers_verdicts_stand_beside_ours(verdict: str) -> None:
    assert verdict in _papers(lab()["stability"])


def _papers(exercise: Exercise) -> list[float | str]:
    """All numbers and words of the paper in the tables of an exercise."""
    given: list[float | str] = []
    for study in exercise.studies.values():
        for values in study.paper.values():
            given += values
        given += [row.paper for row in getattr(study, "rows", ()) if row.paper is not None]
    return given


# The table of contents of the paper: what an exercise's experiment has to be like.
def test_the_papers_experiments_are_those_of_the_exercises() -> None:
    square, step = lab()["speed"].experiment, lab()["stability"].experiment

    assert (square.signal.low, square.signal.high, square.signal.frequency) == (1.0, 3.0, 0.4)  # type: ignore[attr-defined]
    assert "lowpass 50 rad/s" in lab()["filter"].experiment.chain
    assert (step.signal.final, step.duration) == (1.0, 2.5)  # type: ignore[attr-defined]
    assert {square.sample_time, step.sample_time} == {0.002}


def test_all_of_the_papers_parts_have_an_exercise() -> None:
    parts = ("encoder", "driving", "speed", "filter", "step", "pulse", "sinusoid", "stability", "modelling")
    promised = ("identification", "validation", "sampling", "noise")

    assert set(parts + promised) <= set(lab())


# Each table, figure with data and question of the paper, and the exercise that does it again.
ITEMS = {
    "eqs. 1 to 10": "modelling",
    "Table 1,": "modelling",
    "Table 1-3": "sampling",
    "Table 1-4": "filter",
    "Table 1-5": "stability",
    "two channels": "encoder",
    "Figure 1-4": "encoder",
    "2048 counts": "encoder",
    "zero after a restart": "encoder",
    "Figure 1-17 (encoder position)": "encoder",
    "Figure 1-13": "driving",
    "stall monitor": "driving",
    "Figure 1-15": "speed",
    "Figure 1-16": "speed",
    "Figure 1-17 (motor speed)": "filter",
    "Figure 1-18": "filter",
    "Figures 1-19 and 1-20": "stability",
    "Figures 1-21 and 1-22": "pulse",
    "Figure 1-23": "sinusoid",
    "0.13 s": "step",
    "identify the transfer function": "identification",
    "validate the models": "validation",
    "step size against resolution": "sampling",
    "effects of noise": "noise",
}


def test_each_figure_of_the_paper_is_done_again_or_named_among_those_without_numbers() -> None:
    """Its captions go from Figure 1-1 to 1-23; none is passed over, and none is in both lists."""
    items = " ".join(each.item for exercise in lab().values() for each in exercise.paper)
    template = files("servobench.report").joinpath("lab_paper.html.j2").read_text(encoding="utf-8")
    note = template.partition("Its other figures, ")[2].partition(", are ")[0]
    done, left = _figures(re.sub(r"Table 1-\d+", "", items)), _figures(note)

    assert done | left == set(range(1, 24))
    assert not done & left


def _figures(text: str) -> set[int]:
    spans = re.findall(r"1-(\d+)(?: to 1-(\d+))?", text)
    return {n for first, last in spans for n in range(int(first), int(last or first) + 1)}


def test_nowhere_is_it_reported_as_known_where_the_papers_time_constant_comes_from() -> None:
    """The paper has 0.13 s in its poles alone, without a derivation or a reading; that a filter's lag is in it is a guess."""
    told = [
        sentence
        for each in lab().values()
        for sentence in (
            *(part for c in each.corrections for part in (c.paper, c.why)),
            *(mistake.sentence for blank in each.blanks for mistake in blank.mistakes),
        )
        if "0.13 s" in sentence or "paper's figure" in sentence
    ]

    assert told
    for claim in (
        "read off a filtered speed",
        "the filter's lag is in",
        "has the lag of the filter",
        "from a step whose",
    ):
        assert not [sentence for sentence in told if claim in sentence]


@pytest.mark.parametrize("item", ITEMS)
def test_each_item_of_the_paper_is_said_to_be_done_in_an_exercise(item: str) -> None:
    assert any(item in each.item for each in lab()[ITEMS[item]].paper)


def test_a_study_that_is_said_to_show_an_item_shows_a_table_or_a_figure() -> None:
    for name in (
        "encoder",
        "driving",
        "speed",
        "modelling",
    ):  # the quick ones; that it stands in the text is checked in reading
        stand = stand_on_the_twin(lab()[name])
        for each in lab()[name].paper:
            if each.study:
                shown = stand.study_result(each.study)
                assert shown.tables or shown.figures, each
