"""Rows of a stream are judged by their times."""

import numpy as np
import pytest

from servobench.recordings.streams.order import RowOrder


def links(order: RowOrder, t: list[float]) -> list[tuple[float, str]]:
    rows = np.arange(len(t), dtype=float)[:, None]
    return [(round(time, 6), link) for time, _, link in order.take(np.array(t), rows)]


def test_a_gap_is_counted_in_rows() -> None:
    order = RowOrder(step=0.1)

    assert links(order, [0.0, 0.1, 0.5, 0.6]) == [(0.0, "next"), (0.1, "next"), (0.5, "gap"), (0.6, "next")]
    assert (order.lost, order.gaps) == (3, 1)


def test_a_damaged_digit_of_a_time_is_no_gap() -> None:
    order = RowOrder(step=0.1)

    assert [time for time, _ in links(order, [0.0, 0.1, 90.2, 0.3, 0.4])] == [0.0, 0.1, 0.3, 0.4]
    assert (order.damaged, order.restarts) == (1, 0)


def test_repeated_and_late_rows_are_left_out() -> None:
    order = RowOrder(step=0.1)

    assert [time for time, _ in links(order, [0.0, 0.1, 0.1, 0.2, 0.15, 0.3])] == [0.0, 0.1, 0.2, 0.3]
    assert (order.repeated, order.late) == (1, 1)


@pytest.mark.parametrize("sent", [[0, 1, 3, 2, 4, 5], [0, 1, 4, 2, 3, 5], [0, 1, 3, 2, 5, 4, 6, 7]])
def test_a_row_that_overtook_the_one_before_has_its_place_behind_it(sent: list[int]) -> None:
    order = RowOrder(step=0.002)
    t = 0.002 * np.array(sent)
    found = order.take(t, t[:, None])

    assert [round(time / 0.002) for time, _, _ in found] == sorted(sent)
    assert [float(row[0]) for _, row, _ in found] == [time for time, _, _ in found]
    assert {link for _, _, link in found} == {"next"}
    assert order.lost == order.late == order.damaged == 0


def test_a_clock_of_microseconds_wraps_after_71_minutes() -> None:
    order = RowOrder(step=1e-3, tick=1e-6)
    ticks = [2**32 - 1500, 2**32 - 500, 500, 1500]

    found = order.take(1e-6 * np.array(ticks), np.zeros((4, 1)))

    np.testing.assert_allclose(np.diff([time for time, _, _ in found]), 1e-3, rtol=1e-6)
    assert (order.clock_wraps, order.lost, order.restarts) == (1, 0, 0)


def test_a_clock_that_begins_again_is_said() -> None:
    order = RowOrder(step=0.1)

    assert links(order, [50.0, 50.1, 0.0, 0.1])[2:] == [(0.0, "restart"), (0.1, "next")]
    assert order.restarts == 1


def test_another_rate_is_no_loss() -> None:
    order = RowOrder(step=0.01)
    slow = [1.0 + 0.05 * k for k in range(200)]

    found = links(order, [0.01 * k for k in range(100)] + slow)

    assert len(found) == 300
    assert [link for _, link in found].count("rate") == 1
    assert (order.rate_changes, order.lost) == (1, 0)
    assert abs(order.step - 0.05) < 1e-9


def test_a_clock_of_16_bits_in_microseconds_wraps_each_65_ms_and_its_rows_are_not_late() -> None:
    order = RowOrder(step=1e-3, tick=1e-6)
    ticks = np.arange(0, 200_000, 1000)

    found = order.take(1e-6 * (ticks % 2**16), np.zeros((len(ticks), 1)))

    np.testing.assert_allclose([time for time, _, _ in found], 1e-6 * ticks, atol=1e-9)
    assert (order.clock_wraps, order.late, order.restarts) == (3, 0, 0)


def test_a_row_that_comes_late_by_the_range_of_a_narrower_clock_is_late() -> None:
    order = RowOrder(step=1e-3, tick=1e-6)
    ticks = [*range(0, 100_000, 1000), 34_000, 100_000]

    order.take(1e-6 * np.array(ticks), np.zeros((len(ticks), 1)))

    assert (order.clock_wraps, order.late) == (0, 1)


def test_a_clock_that_wrapped_and_began_again_begins_again_once() -> None:
    order = RowOrder(step=1e-3, tick=1e-6)
    ticks = np.array([*range(2**32 - 3500, 2**32, 1000), *range(500, 3_000_000, 1000), *range(0, 5000, 1000)])

    order.take(1e-6 * ticks, np.zeros((len(ticks), 1)))

    assert (order.clock_wraps, order.restarts, order.damaged) == (1, 1, 0)
