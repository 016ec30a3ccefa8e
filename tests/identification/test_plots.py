"""Plots for the prompt: axes come back, those that are given are used, and what is drawn is what the fit has."""

from __future__ import annotations

import copy
import json
import pickle  # noqa: TID251 - what users do to results; only bytes of our own are read
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure

import servobench as sb
from servobench.core.errors import NotIdentifiable, UnknownName, UsageError
from servobench.recordings.adapters.base import recordings_in
from tests.recordings.test_reading import AS_ARRAYS, COLUMNS, T, U, Y, speed

mpl.use("Agg")


@pytest.fixture(scope="module")
def result() -> Any:
    noisy = Y + np.random.default_rng(3).normal(0, 0.2, len(Y))
    return sb.identify(**{**AS_ARRAYS, "y": noisy})


PLOTS = {"plot": 1, "plot_residuals": 2, "plot_bode": 2}


@pytest.mark.parametrize("dark", [False, True])
@pytest.mark.parametrize("name", PLOTS)
def test_a_plot_is_drawn_into_the_axes_that_are_given_and_returns_them(
    result: Any, name: str, dark: bool
) -> None:
    figure = Figure()
    axes = figure.subplots(PLOTS[name], 1, squeeze=False)[:, 0]
    drawn = getattr(result, name)(axes, dark=dark)
    assert list(drawn) == list(axes)
    assert all(len(ax.lines) + len(ax.collections) > 0 for ax in drawn)


def test_the_plot_shows_what_was_measured_and_what_the_model_says(result: Any) -> None:
    (ax,) = result.plot()
    measured, model = ax.lines
    record = result.fit.records[0]
    assert np.array_equal(measured.get_ydata(), record.data.y)
    assert np.array_equal(model.get_ydata(), record.prediction[record.valid])
    assert ax.get_ylabel() == "speed (rad/s)"


def test_the_bars_of_a_budget_add_up_to_the_interval(result: Any) -> None:
    (ax, *_) = result.plot_budget()
    widths = [bar.get_width() for bar in ax.patches]
    # Half-widths of independent lines add in squares; lines below a ten-thousandth of a variance aren't drawn.
    assert np.hypot.reduce(widths) == pytest.approx(1.96 * result["gain"].sd, rel=1e-3)


def test_the_wrong_axes_are_refused(result: Any) -> None:
    with pytest.raises(UsageError, match="expected 2 of Matplotlib's axes"):
        result.plot_bode(Figure().subplots())
    with pytest.raises(UsageError, match="expected 1 of Matplotlib's axes"):
        result.plot("axes")


def test_a_notebook_shows_the_parameters_the_verdict_and_a_picture(result: Any) -> None:
    page = result._repr_html_()
    assert "<th>gain</th>" in page
    assert str(result["gain"]) in page
    assert str(result.verdict) in page.lower()
    assert "data:image/png;base64," in page


def test_a_result_is_short_at_the_prompt_and_a_frame_for_pandas(result: Any) -> None:
    assert len(repr(result).splitlines()) == 1
    frame = result.to_frame()
    assert frame.loc["gain", "value"] == result["gain"].value
    assert frame.loc["gain", "unit"] == "rad/(s·V)"


def test_a_result_without_a_model_has_nothing_to_plot() -> None:
    still = sb.identify(**{**AS_ARRAYS, "y": np.zeros(len(T))})
    with pytest.raises(NotIdentifiable, match="no model"):
        still.plot()
    assert "refused" in still._repr_html_().lower()


def test_a_recording_plots_its_input_and_output_or_the_channels_that_are_named() -> None:
    (recording,) = recordings_in(COLUMNS)
    assert len(recording.plot()) == len(COLUMNS)
    (ax,) = recording.plot("speed")
    assert np.array_equal(ax.lines[0].get_ydata(), Y)
    with pytest.raises(UsageError, match="has no channel 'x'"):
        recording.plot("x")


def test_models_are_compared_on_the_same_data(result: Any) -> None:
    slow = sb.identify(**{**AS_ARRAYS, "y": 0.5 * Y})
    found = sb.compare({"right": result, "wrong": slow}, **AS_ARRAYS)
    right, wrong = found.simulations
    assert right.fit_percent > 99
    # The gain of the second is half as large: by the definition of the fit, 100 (1 - |y - y/2| / |y - mean|).
    assert wrong.fit_percent == pytest.approx(
        100 * (1 - np.linalg.norm(Y[wrong.record.valid] / 2) / np.linalg.norm(Y - Y.mean())), abs=0.5
    )
    (ax,) = found.plot()
    assert len(ax.lines) == 3


def test_a_result_simulates_and_survives_pickling(result: Any) -> None:
    y = result.simulate(T, U)
    for other in (pickle.loads(pickle.dumps(result)), copy.deepcopy(result)):
        assert np.array_equal(other.simulate(T, U), y)
    # Another route to the same answer: the motor's exact recursion with what was found; a delay below a sample moves the steps
    # by a part of one, which is 2 % of the largest slope's way.
    found = [float(result[name]) for name in ("gain", "time_constant", "coulomb_voltage")]
    other = speed(U - found[2], gain=found[0], tau=found[1])
    assert np.allclose(y, other, atol=0.02 * np.abs(y).max())


def test_a_result_that_was_written_loads_with_its_values_and_intervals(result: Any, tmp_path: Path) -> None:
    file = tmp_path / "result.json"
    file.write_text(json.dumps(result.to_dict()), encoding="utf-8")
    loaded = sb.load_result(file)
    assert loaded["gain"] == result["gain"]
    assert str(result.verdict) in str(loaded)
    with pytest.raises(UnknownName, match="no parameter called 'tau'"):
        loaded["tau"]


def test_a_result_lists_its_parameters_and_refuses_an_output_that_isnt_one(result: Any) -> None:
    assert "gain" in result
    assert {"gain", "time_constant"} <= set(result)
    assert f"{result['gain']:.1f}" == f"{result['gain'].value:.1f}"
    for call in (lambda: result.to_control("Speed"), lambda: result.simulate(T, U, output="foo")):
        with pytest.raises(UsageError, match="expected 'position' or 'speed'"):
            call()
    with pytest.raises(UnknownName, match="no parameter called 0"):
        result[0]
    with pytest.raises(UsageError, match=r"estimator is 3 \(int\)"):
        sb.identify(**AS_ARRAYS, estimator=3)
