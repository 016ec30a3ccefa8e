"""The bench of pages that see the motor no more, with one of them; the others are in tests/panel/test_unseen.py."""

import pytest
import unseen  # type: ignore[import-not-found]


@pytest.mark.long
def test_the_motor_is_at_zero_volts_within_a_second() -> None:
    for figure in unseen.main(count=1, ways=("2 s behind",)):
        assert figure.is_kept, figure
