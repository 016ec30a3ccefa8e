"""The bench of the ring, with few rows: it counts what was torn or lost; its times are held against nothing here."""

import ring  # type: ignore[import-not-found]


def test_nothing_is_torn_or_lost_uncounted_and_every_figure_is_there() -> None:
    figures = {figure.what: figure for figure in ring.main(rows=300_000)}

    assert figures["rows torn"].value == 0
    assert figures["rows lost and not counted"].value == 0
    assert all(figure.value > 0 for figure in figures.values() if figure.unit == "ns")
