"""A motor turns only while somebody sees it: what becomes of it where the driving page shows it no more."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from tests.panel.unseen import LIMIT, WAYS, Journal, panel, unseen
from tests.stories.program import Program

pytest.importorskip("starlette", reason="the panel's extra is absent: starlette")


SOON = ("frozen", "2 s behind")
"""A page that says nothing more, as one whose thread or process hangs does; and one that says what is late."""


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Program, Journal]]:
    with panel(tmp_path_factory.mktemp("journal"), 0.01) as found:
        yield found


@pytest.mark.promise("S48")
@pytest.mark.parametrize(
    "way",
    [
        pytest.param(way, marks=[] if way in SOON else [pytest.mark.long])
        for way in WAYS
        if "slowed" not in way
    ],
)
def test_a_page_that_shows_the_motor_no_more_is_zero_volts_within_a_second(
    browser: Any, bench: tuple[Program, Journal], way: str
) -> None:
    found = unseen(browser, *bench, way)

    assert found.zero <= LIMIT
    assert found.why.startswith("the driving page ")


@pytest.mark.promise("S48")
def test_a_page_that_is_slowed_keeps_up_or_is_zero_volts_before_it_is_a_second_behind(
    browser: Any, bench: tuple[Program, Journal]
) -> None:
    found = unseen(browser, *bench, "slowed 20 times")

    assert found.behind <= LIMIT
