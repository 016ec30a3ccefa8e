"""The measured current of the armature on its way into a dataset."""

from dataclasses import replace

import numpy as np
import pytest

from servobench.core.channels import Channel, DeviceInfo
from servobench.core.errors import UsageError
from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.measurement.measure import measure
from servobench.recordings.recording import Recording, Series, Source

T = 0.002 * np.arange(500)
I = 0.1 + 0.05 * np.sin(30 * T)


def recording(*extra: Series, input: str = "u") -> Recording:
    return Recording(
        name="test.csv",
        series=(
            Series(channel=Channel(name="u", unit="V"), values=np.where(T < 0.5, 1.0, 3.0), t=T),
            Series(channel=Channel(name="theta", unit="rad"), values=30.0 * T**2, t=T),
            *extra,
        ),
        source=Source(name="test.csv", sha256="ab", format="csv"),
        input=input,
        output="theta",
        input_before=1.0,  # so that no output is left out for what may have driven the shaft before
    )


def series(name: str, unit: str | None, values: np.ndarray = I, t: np.ndarray = T) -> Series:
    return Series(channel=Channel(name=name, unit=unit), values=values, t=t)


def codes(data: Dataset) -> set[str]:
    return {finding.code for finding in data.findings}


@pytest.mark.parametrize(
    ("name", "unit", "factor"), [("current", "A", 1.0), ("Motor Current [mA]", "mA", 1e-3)]
)
def test_a_current_comes_along_in_amperes(name: str, unit: str, factor: float) -> None:
    data = measure(recording(series(name, unit)))

    assert data.current is not None
    np.testing.assert_allclose(data.current, factor * I, rtol=1e-15)
    assert "current-recognised" in codes(data)


@pytest.mark.parametrize(
    "extra", [series("current", None), series("current", "V"), series("index", "A"), series("i", "rad")]
)
def test_a_channel_that_may_be_something_else_is_no_current(extra: Series) -> None:
    assert measure(recording(extra)).current is None


def test_an_input_is_not_the_measured_current() -> None:
    driven = recording(series("current", "A"), input="current")

    assert measure(driven).current is None


def test_two_currents_are_asked_about() -> None:
    data = measure(recording(series("ia", "A"), series("motor_current", "mA")))

    assert data.current is None
    sentence = next(f.sentence for f in data.findings if f.code == "current-ambiguous")
    assert "'ia', 'motor_current'" in sentence


def test_a_current_at_some_of_the_times_is_unknown_at_the_others() -> None:
    data = measure(recording(series("current", "A", I[::5], T[::5])))

    assert data.current is not None
    np.testing.assert_array_equal(data.current[::5], I[::5])
    assert np.isnan(np.delete(data.current, np.arange(0, 500, 5))).all()


def test_a_current_at_other_times_is_reported_and_not_interpolated() -> None:
    data = measure(recording(series("current", "A", I, T + 0.001)))

    assert data.current is None
    assert "current-at-other-times" in codes(data)


def test_a_device_that_has_a_current_needs_no_finding() -> None:
    info = DeviceInfo(name="rig", channels=(Channel(name="current", unit="A"),))
    data = measure(replace(recording(series("current", "A")), info=info))

    assert data.current is not None
    assert "current-recognised" not in codes(data)


def test_a_part_keeps_its_own_samples_of_the_current() -> None:
    part = measure(recording(series("current", "A"))).part(0.2, 0.4)

    assert part.current is not None
    np.testing.assert_array_equal(part.current, I[100:200])


@pytest.mark.parametrize("current", [I[:-1], np.where(T > 0.5, np.inf, I)])
def test_a_current_that_does_not_fit_the_output_is_refused(current: np.ndarray) -> None:
    data = measure(recording())

    with pytest.raises(UsageError, match="the current has shape"):
        replace(data, current=current)
