import numpy as np
import pytest

from servobench.recordings.formats.stale import fresh_rows, stale

T = 0.005 * np.arange(2000)
MOTION = np.cumsum(2 + np.sin(3 * T)) * 0.005  # a speed that varies, as in any experiment


def held(values: np.ndarray, rows: int) -> np.ndarray:
    """The values as a log shows them that gets a new one every so many rows."""
    return values[np.arange(len(values)) // rows * rows]


@pytest.mark.parametrize("rows", [2, 3, 11, 40])
def test_a_sensor_that_is_asked_less_often_than_the_log_gets_rows_is_found(rows: int) -> None:
    found = stale(held(MOTION, rows))

    assert found is not None
    assert found.hold == rows
    assert found.share == pytest.approx(1 / rows, rel=0.05)  # the last hold may be cut: 1 of at least 50
    assert f"about every {rows} rows ({5 * rows} ms)" in found.sentence("y", T)


def test_the_age_is_in_the_time_that_uneven_rows_take_and_not_in_usual_steps() -> None:
    """Rows 5 ms apart, but for every fourth, which comes 25 ms after the one before: 10 ms on average."""
    found = stale(held(MOTION, 8))
    assert found is not None

    times = np.cumsum(np.where(np.arange(2000) % 4 == 0, 0.025, 0.005))

    assert "about every 8 rows (80 ms)" in found.sentence("y", times)


def test_a_position_at_one_speed_is_stale_although_its_steps_are_alike() -> None:
    """From rest to a speed at which a refresh finds the same way: many steps of its sensor, which showed single ones before."""
    way = 5.0 * (T - 0.2 * -np.expm1(-T / 0.2))
    counts = np.round(held(way, 4) * 2048)

    assert stale(counts) is not None
    assert stale(np.round(way * 40)) is None  # steps of one count are all that there is to see


def test_a_coarse_encoder_is_not_stale() -> None:
    counts = np.floor(MOTION * 20)
    assert np.mean(np.diff(counts) != 0) < 0.5

    assert stale(counts) is None


def test_a_coarse_converter_whose_values_were_rounded_is_not_stale() -> None:
    degrees = np.round(np.floor(MOTION * 20) * 3.515625, 2)

    assert stale(degrees) is None


@pytest.mark.parametrize(
    "values",
    [
        MOTION,
        np.minimum(MOTION, MOTION[200]),  # at rest after the motion
        np.repeat([0.0, 1.0, 2.5, 3.0], 500),  # too few changes to tell
        np.zeros(2000),
        np.full(2000, np.nan),
        np.empty(0),
    ],
)
def test_what_is_fresh_at_rest_or_empty_is_not_stale(values: np.ndarray) -> None:
    assert stale(values) is None


@pytest.mark.parametrize("rows", [3, 11, 40])
def test_the_rows_in_which_a_value_is_new_are_found_through_a_rest_too(rows: int) -> None:
    # The motion begins in the fourth hold and rests for ten holds in the middle; the log begins within a hold.
    motion = np.interp(
        np.arange(60 * rows), [3 * rows, 20 * rows, 30 * rows, 60 * rows], [0.0, 17.3, 17.3, 49.1]
    )
    late = rows // 2
    values = held(motion, rows)[late:]

    kept = fresh_rows(values, rows)

    assert (kept + late).tolist() == list(range(rows, 60 * rows, rows))
