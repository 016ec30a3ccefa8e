"""Clocks that agree, and clocks that don't: spans by arithmetic, no clock is looked at."""

from __future__ import annotations

import pytest

from servobench.core.finding import Severity
from servobench.rig.loop.pace import Spans, pace


def codes(spans: Spans) -> list[str]:
    return [finding.code for finding in pace(spans)]


def test_clocks_that_agree_are_no_news() -> None:
    assert codes(Spans(sample_time=0.002, ticks=9.998, device=9.998, host=9.9985)) == []


def test_a_simulation_alone_has_nothing_to_disagree_with() -> None:
    assert codes(Spans(sample_time=0.002, ticks=9.998, device=9.998)) == []
    assert codes(Spans(sample_time=0.002, ticks=9.998)) == []


@pytest.mark.parametrize(("span", "limit"), [(10.0, 0.004), (3600.0, 0.722)])
def test_the_limit_is_a_tick_and_two_hundred_parts_per_million(span: float, limit: float) -> None:
    # 2 ms and 200 ppm of the span: 2 + 2 ms after 10 s, 2 + 720 ms after an hour.
    within = Spans(sample_time=0.002, ticks=span, host=span + 0.99 * limit)
    beyond = Spans(sample_time=0.002, ticks=span, host=span + 1.01 * limit)

    assert (codes(within), codes(beyond)) == ([], ["clocks-disagree"])


def test_a_simulation_that_missed_steps_beside_the_wall_clock_is_reported_with_all_three_spans() -> None:
    """500 of 5,000 ticks were missed, and the simulation stood still in them."""
    (finding,) = pace(Spans(sample_time=0.002, ticks=9.998, device=8.998, host=9.998))

    assert finding.severity is Severity.WARNING
    assert (
        "9.998 s by its ticks, 8.998 s by the device's own time, 9.998 s by the computer's clock"
        in finding.sentence
    )
    assert "up to 10 % apart" in finding.sentence


def test_a_device_with_a_ceramic_resonator_is_reported() -> None:
    """Half a per cent fast, over a minute: 300 ms, of which 2 + 16 + 12 ms are allowed."""
    spans = Spans(sample_time=0.002, ticks=60.0, device=60.0, host=60.3, handed_on=True)

    assert codes(spans) == ["clocks-disagree"]


def test_a_last_sample_that_was_late_or_on_its_way_is_no_disagreement() -> None:
    late = Spans(sample_time=0.001, ticks=1.0, host=1.012, late=0.0115)
    on_its_way = Spans(sample_time=0.001, ticks=1.0, device=1.0, host=1.015, handed_on=True)

    assert (codes(late), codes(on_its_way)) == ([], [])
    assert codes(Spans(sample_time=0.001, ticks=1.0, host=1.012)) == ["clocks-disagree"]


def test_a_device_that_leaves_its_time_at_zero_says_nothing() -> None:
    assert codes(Spans(sample_time=0.002, ticks=10.0, device=0.0, host=10.0)) == []
