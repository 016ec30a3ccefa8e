"""How the answer to a why is worded."""

from servobench.identification.reconciliation.judgement import Size
from servobench.identification.reconciliation.sentences import size_range_text


def test_an_interval_whose_ends_are_alike_is_not_written_out() -> None:
    size = Size(value=0.1, text="below 28 rad/s", low="below 28 rad/s", high="below 28 rad/s")

    assert size_range_text(size) == "below 28 rad/s"


def test_an_open_end_keeps_its_unit() -> None:
    size = Size(value=0.1, text="33 rad/s", low="below 28 rad/s", high="40 rad/s")

    assert size_range_text(size) == "33 rad/s (below 28 rad/s to 40 rad/s)"
