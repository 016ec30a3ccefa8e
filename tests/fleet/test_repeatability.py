"""Gauge R&R against the worked example of the AIAG's manual, and what can't be studied."""

import numpy as np
import pytest

from servobench.core.errors import UsageError
from servobench.fleet.repeatability import gauge_study, study_values

# AIAG, Measurement Systems Analysis, 3rd and 4th edition, chapter III: three appraisers, three trials, ten parts.
AIAG = np.array([
    [[0.29, -0.56, 1.34, 0.47, -0.80, 0.02, 0.59, -0.31, 2.26, -1.36],
     [0.41, -0.68, 1.17, 0.50, -0.92, -0.11, 0.75, -0.20, 1.99, -1.25],
     [0.64, -0.58, 1.27, 0.64, -0.84, -0.21, 0.66, -0.17, 2.01, -1.31]],
    [[0.08, -0.47, 1.19, 0.01, -0.56, -0.20, 0.47, -0.63, 1.80, -1.68],
     [0.25, -1.22, 0.94, 1.03, -1.20, 0.22, 0.55, 0.08, 2.12, -1.62],
     [0.07, -0.68, 1.34, 0.20, -1.28, 0.06, 0.83, -0.34, 2.19, -1.50]],
    [[0.04, -1.38, 0.88, 0.14, -1.46, -0.29, 0.02, -0.46, 1.77, -1.49],
     [-0.11, -1.13, 1.09, 0.20, -1.07, -0.67, 0.01, -0.56, 1.45, -1.77],
     [-0.15, -0.96, 0.67, 0.11, -1.45, -0.49, 0.21, -0.49, 1.87, -2.16]],
]).transpose(2, 0, 1)  # fmt: skip


def test_the_analysis_of_variance_is_the_published_one() -> None:
    lines = {line.source: line for line in gauge_study(AIAG).lines}

    # As printed: to four digits behind the point, mean squares to five.
    for source, dof, squares, mean in (
        ("part", 9, 88.3619, 9.81799),
        ("operator", 2, 3.1673, 1.58363),
        ("part × operator", 18, 0.3590, 0.01994),
        ("repeatability", 60, 2.7589, 0.04598),
    ):
        assert lines[source].dof == dof
        assert lines[source].sum_squares == pytest.approx(squares, abs=5e-5)
        assert lines[source].mean_square == pytest.approx(mean, abs=5e-6)
    assert lines["part × operator"].p == pytest.approx(0.974, abs=5e-4)


def test_the_components_are_the_published_ones() -> None:
    study = gauge_study(AIAG)

    assert study.pooled
    assert study.categories == 4
    for name, variance, share, sd, of_study in (
        ("gauge", 0.09143, 7.76, 0.30237, 27.86),
        ("repeatability", 0.03997, 3.39, 0.19993, 18.42),
        ("reproducibility", 0.05146, 4.37, 0.22684, 20.90),
        ("part", 1.08645, 92.24, 1.04233, 96.04),
        ("total", 1.17788, 100.0, 1.08530, 100.0),
    ):
        found = study.components[name]
        assert found.variance == pytest.approx(variance, abs=5e-6)
        assert found.contribution == pytest.approx(share, abs=5e-3)
        assert found.sd == pytest.approx(sd, abs=5e-6)
        assert found.of_study == pytest.approx(of_study, abs=5e-3)


def test_the_share_of_the_tolerance_is_six_standard_deviations() -> None:
    assert gauge_study(AIAG, tolerance=8.0).components["gauge"].of_tolerance == pytest.approx(
        100 * 6 * 0.30237 / 8, abs=1e-3
    )
    assert gauge_study(AIAG).components["gauge"].of_tolerance is None


def test_variances_of_a_simulated_study_are_found() -> None:
    """40 parts × 8 stands × 5 trials of known variances; the relative sd of a variance of f degrees of freedom is sqrt(2/f)."""
    random = np.random.default_rng(8)
    n, o, k = 40, 8, 5
    y = (
        random.normal(0, 2.0, (n, 1, 1)) + random.normal(0, 1.0, (1, o, 1))
        + random.normal(0, 0.7, (n, o, 1)) + random.normal(0, 0.5, (n, o, k))
    )  # fmt: skip
    study = gauge_study(y)

    assert not study.pooled
    for name, sd, freedom in (
        ("part", 2.0, n - 1), ("operator", 1.0, o - 1), ("interaction", 0.7, (n - 1) * (o - 1)),
        ("repeatability", 0.5, n * o * (k - 1)),
    ):  # fmt: skip
        assert study.components[name].variance == pytest.approx(sd**2, rel=3.5 * np.sqrt(2 / freedom)), name


def test_one_operator_has_no_reproducibility() -> None:
    study = gauge_study(AIAG[:, :1])

    assert [line.source for line in study.lines] == ["part", "repeatability"]
    assert study.components["reproducibility"].variance == 0
    within = AIAG[:, 0].var(axis=1, ddof=1).mean()
    assert study.components["repeatability"].variance == pytest.approx(within)


@pytest.mark.parametrize("shape", [(1, 3, 3), (10, 3, 1), (0, 0, 0)])
def test_a_study_without_repetition_is_reported(shape: tuple[int, ...]) -> None:
    with pytest.raises(UsageError, match="expected at least 2 parts"):
        gauge_study(np.zeros(shape))


def test_values_are_ordered_by_part_operator_and_trial() -> None:
    y = study_values(
        [8.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0], list("baaaabbb"), list("BAABBAAB"), list("21221211")
    )

    assert y.tolist() == [[[1.0, 2.0], [4.0, 3.0]], [[6.0, 5.0], [7.0, 8.0]]]


def test_a_missing_trial_is_named() -> None:
    with pytest.raises(UsageError, match="part b by B has 1 usable trials where others have 2"):
        study_values([1.0] * 7, list("aaaabbb"), list("AABBAAB"), list("1212121"))
