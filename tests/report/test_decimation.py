import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from servobench.report.decimation import decimate, hold_line


@given(st.integers(1, 3000), st.integers(1, 60), st.integers(0, 2**32 - 1))
def test_every_column_of_pixels_keeps_its_first_last_lowest_and_highest_value(
    n: int, columns: int, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.exponential(size=n) + 1e-9)
    y = rng.standard_normal(n)

    t_less, y_less = decimate(t, y, columns)

    assert len(t_less) <= max(4 * columns, n if n <= 4 * columns else 0)
    assert set(zip(t_less, y_less, strict=True)) <= set(zip(t, y, strict=True))
    # Brute force: the column of each sample, counted in the same way.
    edges = np.linspace(t[0], t[-1], columns + 1)[1:-1]
    column, column_less = np.searchsorted(edges, t, "right"), np.searchsorted(edges, t_less, "right")
    for c in np.unique(column):
        of_all, of_less = y[column == c], y_less[column_less == c]
        assert (of_all[0], of_all[-1], of_all.min(), of_all.max()) == (
            of_less[0], of_less[-1], of_less.min(), of_less.max(),
        )  # fmt: skip


def test_a_single_spike_among_millions_of_samples_is_still_drawn() -> None:
    y = np.zeros(2_000_000)
    y[1_234_567] = 1.0

    t_less, y_less = decimate(np.arange(2e6), y, 600)

    assert len(y_less) <= 2400
    assert t_less[np.argmax(y_less)] == 1_234_567


def test_an_input_is_drawn_with_upright_edges_and_to_the_end_of_the_record() -> None:
    t, u = hold_line(np.array([0.0, 1.0, 2.0]), np.array([2.0, 2.0, 5.0]), 0.0, 3.0)

    assert list(zip(t, u, strict=True)) == [(0, 0), (0, 0), (0, 2), (2, 2), (2, 5), (3, 5)]


def test_an_input_that_never_changes_is_one_line() -> None:
    t, u = hold_line(np.array([0.0, 1.0]), np.array([2.0, 2.0]), 2.0, 3.0)

    assert (t.tolist(), u.tolist()) == ([0.0, 3.0], [2.0, 2.0])
