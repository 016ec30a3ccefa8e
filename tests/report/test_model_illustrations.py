"""The statements under a model's figures: bandwidth, rise time, and the margins of feedback, each with its interval."""

import re
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.text import Text
from scipy.optimize import brentq

from servobench.identification.estimators.base import FittedRecord
from servobench.identification.uncertainty.propagation import derive
from servobench.report.model_illustrations import frequency_response, poles, step_response
from tests.report.makers import dataset, fit_of

SD = np.array([0.02, 1e-4, 0.01, 2e-5])
FEEDBACK = "With unit feedback of the position (1 V for each rad), computed every 2 ms,"


def caption(theta: tuple[float, ...], sd: np.ndarray = SD) -> str:
    fit = fit_of(theta, np.diag(sd**2))
    return poles(fit, derive(fit)).caption


def test_bandwidth_and_rise_time_stand_under_their_figures() -> None:
    data = dataset(samples=50)
    nothing = np.zeros(50)
    record = FittedRecord(
        data=data,
        nuisance=np.zeros(2),
        prediction=data.y,
        residual=nothing,
        innovations=nothing,
        valid=nothing == 0,
    )
    fit = replace(fit_of((20.0, 0.1, 0.3, 0.002), np.diag(SD**2)), records=(record,))

    bode, step = frequency_response(fit, derive(fit)), step_response(fit, derive(fit))

    # 1/τ and τ ln 9, both known to 0.1 % · 1.96
    assert bode is not None
    assert "0.707 of its static value) is 10.000 ± 0.020 rad/s." in bode.caption.replace("\u00a0", " ")
    assert "The rise time from 10 to 90 % is 0.21972 ± 0.00043 s." in step.caption.replace("\u00a0", " ")


def test_the_margins_of_unit_feedback_stand_with_the_poles() -> None:
    # K (c₁ z + c₂)/((z - 1)(z - a)) behind one tick of 2 ms, worked out apart: |L| = 1, and L real and negative.
    h, a = 0.002, np.exp(-0.002 / 0.1)
    c1, c2 = h - 0.1 * (1 - a), 0.1 * (1 - a) - a * h

    def loop(omega: float) -> complex:
        z = np.exp(1j * omega * h)
        return complex(20.0 * (c1 * z + c2) / ((z - 1) * (z - a)) / z)

    at_one = brentq(lambda omega: abs(loop(omega)) - 1, 5, 50)
    at_turn = brentq(lambda omega: loop(omega).imag, 20, 200)
    phase = 180 + np.degrees(np.angle(loop(at_one)))
    told = caption((20.0, 0.1, 0.3, 0.002)).replace("\u00a0", " ")

    assert f"{FEEDBACK} the phase margin is {phase:.3f} ±" in told
    assert f"° at {at_one:.3f} ±" in told
    assert f"the gain margin {20 * np.log10(1 / abs(loop(at_turn))):.2f} ±" in told
    assert told.endswith(f"at {at_turn:.1f} rad/s.")


@pytest.mark.parametrize(
    ("theta", "sentence"),
    [
        ((20.0, 0.1, 0.3, 0.2), "the loop would be unstable."),
        ((-20.0, 0.1, 0.3, 0.0), "the loop would be unstable."),
    ],
)
def test_loops_without_a_limit_and_unstable_ones_are_said_to_be_so(
    theta: tuple[float, ...], sentence: str
) -> None:
    assert sentence in caption(theta)


def test_an_interval_that_isn_t_even_is_reported_by_its_ends() -> None:
    # The delay may be none or 10 ms: at 57 rad/s the gain margin falls with it, and is bounded without it by the hold.
    told = caption((20.0, 0.1, 0.3, 0.002), np.array([0.02, 1e-4, 0.01, 4e-3])).replace("\u00a0", " ")

    ends = re.search(r"the gain margin 24.5 dB \(95 %: ([\d.]+) dB to ([\d.]+) dB\)", told)
    assert ends
    # Without a delay |z| = 1 at k = (1 - a)/c₂: 34.1 dB, of which two digits are printed.
    a = np.exp(-0.02)
    assert float(ends[2]) == pytest.approx(
        20 * np.log10((1 - a) / (20 * (0.1 * (1 - a) - 0.002 * a))), abs=0.5
    )


def test_parameters_that_the_data_don_t_tell_leave_no_interval() -> None:
    fit = replace(
        fit_of((20.0, 0.1, 0.3, 0.002), np.diag(SD**2)), covariance=np.diag([4e-4, 1e-8, 1e-4, np.inf])
    )

    told = poles(fit, derive(fit)).caption.replace("\u00a0", " ")

    assert "the phase margin is 36.52" in told
    assert "nan" not in told


def test_a_fit_to_measured_points_shows_them() -> None:
    from servobench.identification.identify import identify
    from servobench.report.palette import Style
    from tests import datasets

    data = datasets.dataset(seed=1, kind="square")
    result = identify(data, structure="first_order_one_way", estimator="frequency_response")
    assert result.fit is not None
    shown = frequency_response(result.fit, result.derived)
    assert shown is not None
    figure = shown.draw(Style())
    # The model's own diagram has no coherence.
    words = {text.get_text() for text in figure.findobj(Text)}
    assert {"Magnitude (dB)", "Phase (°)", "Coherence"} <= words
