"""Stability and data: what a record says, and what intervals leave open."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from servobench.core.channels import Array
from servobench.core.rounding import plain
from servobench.identification.estimators.base import Fit
from servobench.identification.uncertainty.stability import (
    continuous_loop_over_intervals,
    loop_over_intervals,
    stability_over_intervals,
)
from servobench.recordings.boundedness import bibo
from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.recording import Source
from servobench.systems.margins import margins
from servobench.systems.transfer_function import TransferFunction
from tests.report.makers import fit_of

QUANTUM = 2 * np.pi / 2048
T = np.arange(0, 2.5, 0.002)


def record(
    y: Array, u: Array | None = None, *, kind: str = "position", quantum: float | None = None
) -> Dataset:
    return Dataset(
        name="made",
        t_input=T,
        u=np.ones_like(T) if u is None else u,
        input_unit="V",
        input_before=0.0,
        t_output=T,
        y=y,
        output_unit="rad" if kind == "position" else "rad/s",
        kind=kind,  # type: ignore[arg-type]
        source=Source(name="made"),
        quantum=quantum,
    )


def counted(position: Array) -> Array:
    return (np.floor(position / QUANTUM) + 0.5) * QUANTUM


def motor(u: float, pole: float = 0.0) -> Array:
    """The position of a motor with τ = 0.1 s and K = 20 after a step, or with a slow pole in the integrator's place."""
    if pole == 0:
        return 20 * u * (T - 0.1 * (1 - np.exp(-T / 0.1)))
    # 20/((0.1 s + 1)(s - p)): residues at p and at -10.
    return (
        20
        * u
        * ((np.exp(pole * T) - 1) / pole / (0.1 * pole + 1) + (np.exp(-10 * T) - 1) / 10 / (1 + 0.1 * pole))
    )


def test_a_position_that_runs_off_is_consistent_with_an_integrator_and_proves_nothing() -> None:
    report = bibo(record(counted(motor(1.0)), quantum=QUANTUM))

    [stretch] = report.stretches
    assert abs(stretch.slopes[1].value - 20) <= stretch.slopes[1].half < 0.02
    assert stretch.exponent is not None
    assert stretch.exponent[0] < 0 < stretch.exponent[1]
    assert "integrator" in stretch.sentence
    assert "No finite record proves" in report.sentences[-1]
    assert report.input_bound == 1.0


def test_what_is_left_of_a_transient_isnt_taken_for_a_pole() -> None:
    """Between 5 and 12 time constants the slope rises by 4 parts in 10⁴ at most: that is no pole to the right."""
    u = np.where(T < 1.25, 1.0, 0.5)
    [first, second] = bibo(
        record(motor(1.0) - np.where(T < 1.25, 0, np.interp(T - 1.25, T, motor(0.5))), u)
    ).stretches

    for stretch in (first, second):
        assert stretch.exponent is not None
        assert stretch.exponent[0] < 0 < stretch.exponent[1]
        assert "integrator" in stretch.sentence


@pytest.mark.parametrize("pole", [-0.5, -0.05, -1e-4, 1e-4, 0.05, 0.5])
def test_the_pole_of_the_mode_that_is_left_is_within_its_interval(pole: float) -> None:
    """The transient of τ = 0.1 s has gone to e^-12 by the middle, so one mode is left."""
    [stretch] = bibo(record(counted(motor(1.0, pole)), quantum=QUANTUM)).stretches

    assert stretch.exponent is not None
    assert stretch.exponent[0] <= pole <= stretch.exponent[1]
    distinguished = (
        abs(pole) > 0.01
    )  # a slope's interval is 1.5 quanta over 0.6 s, 1/2700 of 20 rad/s; twice that over 0.6 s
    assert distinguished == (stretch.exponent[0] * stretch.exponent[1] > 0)
    if distinguished:
        assert ("got faster" if pole > 0 else "got slower") in stretch.sentence
    else:
        slowest = plain(-1 / stretch.exponent[0], 2)
        assert f"a time constant of {slowest}" in stretch.sentence.replace("\u00a0", " ")


def test_intervals_of_slopes_cover_with_noise_that_follows_itself() -> None:
    """A straight line in AR(1) noise: 95 % intervals; of 300, the binomial leaves less than 268 one in ten thousand times."""
    random = np.random.default_rng(5)
    covered = 0
    for _ in range(300):
        noise = random.normal(0, 0.01, len(T))
        for k in range(1, len(T)):
            noise[k] += 0.6 * noise[k - 1]
        [stretch] = bibo(record(3.0 * T + noise)).stretches
        covered += abs(stretch.slopes[0].value - 3.0) <= stretch.slopes[0].half
    assert covered >= 268


def test_a_pulse_that_comes_to_rest_is_no_sign_of_stability() -> None:
    u = np.where(T < 0.3, 1.0, 0.0)
    end = motor(1.0)[T < 0.3][-1]
    position = np.where(T < 0.3, motor(1.0), end + 2.0 * 0.1 * 9.5 * (1 - np.exp(-(T - 0.3) / 0.1)))
    last = bibo(record(counted(position), u, quantum=QUANTUM)).stretches[-1]

    assert last.level == 0.0
    assert last.slopes[1].is_zero
    assert "no sign of stability" in last.sentence


def test_a_speed_that_levels_off_says_nothing_of_other_inputs() -> None:
    [stretch] = bibo(record(20 * (1 - np.exp(-T / 0.1)), kind="speed", quantum=None)).stretches
    assert "nothing" in stretch.sentence or "consistent with a stable system" in stretch.sentence


def test_a_line_without_any_error_has_a_sentence_too() -> None:
    [stretch] = bibo(record(np.arange(len(T), dtype=float))).stretches
    assert "integrator" in stretch.sentence


def test_a_swing_tells_no_pole() -> None:
    [stretch] = bibo(record(np.sin(2 * np.pi * T / 1.25))).stretches
    assert stretch.exponent is None


def test_the_bound_of_the_input_is_that_of_what_acted_before_the_record_too() -> None:
    assert bibo(replace(record(counted(motor(1.0))), input_before=-3.0)).input_bound == 3.0


def test_of_many_stretches_the_six_longest_are_reported_in_their_order() -> None:
    lengths = np.array([0.30, 0.22, 0.28, 0.20, 0.26, 0.32, 0.24])  # and 0.68 s that are left
    starts = np.append(0.0, np.cumsum(lengths))
    level = np.searchsorted(starts, T + 1e-9) % 2 + 1.0
    told = bibo(record(motor(1.0), level)).stretches

    assert [stretch.start for stretch in told] == pytest.approx(starts[[0, 2, 4, 5, 6, 7]], abs=1e-9)


def test_a_sinusoid_has_no_stretch_and_is_told_so() -> None:
    report = bibo(record(np.cos(T), np.sin(2 * np.pi * 0.4 * T)))
    assert report.stretches == ()
    assert "never constant" in report.sentences[1]


def fit(sd: tuple[float, ...] = (0.02, 1e-4, 0.01, 2e-5)) -> Fit:
    return fit_of((20.0, 0.1, 0.3, 0.002), np.diag(np.square(sd)))


def test_a_motor_that_is_well_known_has_one_verdict_everywhere() -> None:
    speed, position = (stability_over_intervals(fit(), around) for around in ("speed", "position"))  # type: ignore[arg-type]

    assert (speed.verdict, speed.everywhere, speed.share) == ("stable", True, 1.0)
    assert (position.verdict, position.everywhere) == ("marginally stable", True)
    assert speed.corners == speed.corners_alike == 16
    assert "in all 16 combinations, and for 600 sets of parameters" in speed.sentence


def test_a_loop_near_its_limit_is_left_open() -> None:
    """k K e^(-ds)/(s (τs + 1)) at its limit for the estimate: half of what the data leave open is on either side."""
    found = fit((0.5, 1e-3, 0.01, 1e-4))
    limit = margins(found.model.transfer_function("position")).gain_margin

    def gain(factor: float) -> TransferFunction:
        return TransferFunction(numerator=(factor * limit,), denominator=(1.0,), output="input", unit="1")

    near = continuous_loop_over_intervals(found, gain(0.9999))
    assert not near.everywhere
    # 600 draws, mirrored pairs: half but for the bend, 0.5 ± 0.02 · 3.
    assert near.share == pytest.approx(0.5, abs=0.06)
    assert "leave it open" in near.sentence
    assert continuous_loop_over_intervals(found, gain(0.5)).everywhere
    assert continuous_loop_over_intervals(found, gain(2.0)).verdict == "unstable"


def test_a_corner_that_no_draw_reaches_leaves_the_verdict_open() -> None:
    """A high gain goes with a short delay here (ρ = -0.9), so that both at their high ends are far from any draw.

    The limit of k K is 1/d, nearly: of the logarithm of K d, each known to 1 %, the standard deviation is √(2 - 1.8) %, and the
    corner 2 · 1.96 % away.
    """
    sd, together = np.array([0.2, 1e-9, 1e-9, 2e-5]), np.eye(4)
    together[0, 3] = together[3, 0] = -0.9
    found = fit_of((20.0, 0.1, 0.3, 0.002), together * np.outer(sd, sd))
    ends = [found.estimates[name].interval for name in found.model.names]
    corners = [replace(found.model, theta=np.array(theta)) for theta in itertools.product(*ends)]
    limits = sorted(margins(corner.transfer_function("position")).gain_margin for corner in corners)
    # Of the time constant and the offset nothing is open: four corners are alike, and this is too much for them only.
    controller = TransferFunction(numerator=(0.5 * (limits[3] + limits[4]),), denominator=(1.0,))
    report = continuous_loop_over_intervals(found, controller)

    assert (report.verdict, report.corners, report.corners_alike) == ("stable", 16, 12)
    assert (report.share, report.everywhere) == (1.0, False)


def test_a_draw_outside_the_corners_leaves_the_verdict_open() -> None:
    """Of the gain alone something is left open: 2.2 standard deviations, at which the loop gets unstable, are beyond 1.96."""
    found = fit((0.5, 1e-9, 1e-9, 1e-9))
    limit = margins(found.model.transfer_function("position")).gain_margin
    controller = TransferFunction(numerator=(limit / (1 + 2.2 * 0.5 / 20),), denominator=(1.0,))
    report = continuous_loop_over_intervals(found, controller)

    assert (report.verdict, report.corners_alike) == ("stable", report.corners)
    # Φ(2.2) = 0.9861; three standard deviations of a binomial share of 600.
    assert report.share == pytest.approx(0.9861, abs=3 * np.sqrt(0.9861 * 0.0139 / 600))
    assert not report.everywhere


def test_corners_stay_within_what_is_possible() -> None:
    """A time constant of 0.1 ± 0.2 s: below zero would be a motor that runs away, which is none."""
    report = stability_over_intervals(fit((0.02, 0.1, 0.01, 2e-5)))
    assert (report.verdict, report.corners_alike) == ("stable", report.corners)


def test_a_delay_that_comes_out_negative_counts_as_none() -> None:
    found = fit()
    early = found.model.theta.copy()
    early[found.model.names.index("delay")] = -1e-4

    assert loop_over_intervals(replace(found, model=replace(found.model, theta=early))).verdict == "stable"


def test_what_the_data_dont_determine_is_named() -> None:
    found = fit()
    covariance = found.covariance.copy()
    covariance[2, 2] = np.inf
    report = stability_over_intervals(replace(found, covariance=covariance))
    assert report.undetermined == (found.model.names[2],)
    assert found.model.names[2].replace("_", " ") in report.sentence
    assert report.corners == 8
