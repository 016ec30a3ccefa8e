"""A duty times its supply is the motor's voltage, whatever units and times the two have."""

from __future__ import annotations

import numpy as np
import pytest

from servobench.core.channels import Channel
from servobench.core.errors import MissingInformation, UsageError
from servobench.recordings.formats.mapping import assign
from servobench.recordings.measurement.measure import measure
from servobench.recordings.recording import Recording, Series, Source
from tests.recordings.formats.tables import finding

T = 0.01 * np.arange(50)
DUTY = np.where(np.arange(50) % 20 < 10, 0.5, -0.25)
THETA = np.cumsum(DUTY)


def servo(
    duty: np.ndarray, unit: str | None, supply: np.ndarray, t_supply: np.ndarray | None = None
) -> Recording:
    series = (
        Series(channel=Channel(name="load", unit=unit), values=duty, t=T),
        Series(channel=Channel(name="theta", unit="rad"), values=THETA, t=T),
        Series(channel=Channel(name="vbat", unit="V"), values=supply, t=T if t_supply is None else t_supply),
    )
    return Recording(name="servo", series=series, source=Source(name="servo.csv"))


@pytest.mark.parametrize(
    ("factor", "unit", "said"), [(1.0, None, "load:1"), (100.0, "%", "load"), (885.0, None, "load:PWM/885")]
)
def test_the_voltage_is_duty_times_supply_in_any_notation_of_a_duty(
    factor: float, unit: str | None, said: str
) -> None:
    supply = np.linspace(8.0, 7.0, 50)

    data = measure(assign(servo(factor * DUTY, unit, supply), input=said, output="theta", supply="vbat"))

    # Two products, each rounded.
    np.testing.assert_allclose(data.u, DUTY * supply, rtol=1e-15)
    assert data.input_unit == "V"
    assert (
        "`motor_voltage`, in V: the duty `load` times the supply `vbat`, 7 to 8 V"
        in finding(data.findings, "supply-applied").sentence
    )


def test_a_duty_of_more_than_the_whole_is_refused_with_what_to_say() -> None:
    recording = servo(1023.0 * DUTY, None, np.full(50, 12.0))

    with pytest.raises(UsageError, match=r"reaches 200.6 % of its supply.*input=COL:PWM/1023"):
        assign(recording, input="load:PWM/255", output="theta", supply="vbat")


@pytest.mark.parametrize("times", [1, 4])
def test_a_single_false_row_of_a_duty_is_no_reason_to_refuse_it(times: int) -> None:
    t = 0.01 * np.arange(50 * times)
    duty = np.tile(DUTY, times)
    duty[17] = 5.0
    series = tuple(
        Series(channel=Channel(name=name, unit=unit), values=values, t=t)
        for name, unit, values in (("load", None, duty), ("theta", "rad", np.cumsum(duty)))
    )
    recording = Recording(name="servo", series=series, source=Source(name="servo.csv"))

    assert assign(recording, input="load:1", output="theta", supply="12 V").input == "motor_voltage"


def test_a_supply_with_times_of_its_own_is_on_straight_lines_and_stays_at_its_ends() -> None:
    recording = servo(DUTY, "1", np.array([8.0, 6.0]), np.array([0.1, 0.3]))

    assigned = assign(recording, input="load", output="theta", supply="vbat")

    expected = np.clip(8.0 - 10.0 * (T - 0.1), 6.0, 8.0)
    np.testing.assert_allclose(assigned["motor_voltage"].values, DUTY * expected, rtol=1e-12)
    assert "straight lines" in finding(assigned.findings, "supply-applied").sentence


def test_samples_of_a_supply_may_come_in_any_order() -> None:
    values, t = np.array([8.0, 7.5, 6.0]), np.array([0.1, 0.2, 0.3])

    ordered, mixed = (
        assign(servo(DUTY, "1", values[order], t[order]), input="load", output="theta", supply="vbat")
        for order in ([0, 1, 2], [2, 0, 1])
    )

    assert mixed["motor_voltage"].values.tolist() == ordered["motor_voltage"].values.tolist()


def test_a_constant_supply_is_a_text_with_its_unit() -> None:
    recording = servo(100 * DUTY, "%", np.ones(50))

    assigned = assign(recording, input="load", output="theta", supply="7400 mV")

    np.testing.assert_allclose(assigned["motor_voltage"].values, 7.4 * DUTY, rtol=1e-15)
    assert assigned.input == "motor_voltage"
    assert assigned.input_before is None


def test_raw_counts_alone_are_a_duty_in_per_cent() -> None:
    data = measure(assign(servo(885 * DUTY, None, np.ones(50)), input="load:PWM/885", output="theta"))

    np.testing.assert_allclose(data.u, 100 * DUTY, rtol=1e-15)
    assert data.input_unit == "%"
    assert "885 counts for 100 %" in finding(data.findings, "duty-scaled").sentence


@pytest.mark.parametrize(
    ("given", "why"),
    [
        ({"input": "load:V", "supply": "vbat"}, "is in V; a supply goes with a duty"),
        ({"input": "load:1", "supply": "vbat:rad"}, "the supply `vbat` is in rad; expected a voltage"),
        ({"input": "load:1", "supply": "-3 V"}, "expected a positive voltage"),
        ({"input": "load:1", "supply": "load:V"}, "`load` can't be both input and supply"),
        ({"input": "load:1", "output": "theta:PWM/885"}, "only the input can be"),
    ],
)
def test_what_is_no_duty_or_no_supply_is_an_error(given: dict[str, str], why: str) -> None:
    with pytest.raises(UsageError, match=why):
        assign(servo(DUTY, None, np.ones(50)), **{"output": "theta", **given})  # type: ignore[arg-type]


def test_the_unit_of_a_supply_is_asked_for() -> None:
    recording = servo(DUTY, "1", np.ones(50))
    bare = tuple(
        Series(channel=Channel(name=each.channel.name, unit=None), values=each.values, t=each.t)
        if each.channel.name == "vbat"
        else each
        for each in recording.series
    )

    with pytest.raises(MissingInformation, match="the unit of the supply `vbat`: say `supply=vbat:UNIT"):
        assign(
            Recording(name="servo", series=bare, source=recording.source),
            input="load",
            supply="vbat",
            output="theta",
        )


def test_a_current_that_is_named_comes_before_one_that_is_recognised() -> None:
    extra = tuple(
        Series(channel=Channel(name=name, unit=unit), values=np.full(50, value), t=T)
        for name, unit, value in (("motor_current", "A", 1.0), ("ia", "A", 2.0), ("shunt", None, 300.0))
    )
    recording = servo(DUTY, "1", np.ones(50))
    recording = Recording(name="servo", series=(*recording.series, *extra), source=recording.source)

    data = measure(assign(recording, input="load", output="theta", current="shunt:mA"))

    assert data.current is not None
    np.testing.assert_allclose(data.current, 0.3, rtol=1e-15)
    codes = {each.code for each in data.findings}
    assert "current-named" in codes
    assert not {"current-ambiguous", "current-recognised"} & codes
    with pytest.raises(UsageError, match="the current `shunt` is in V; expected A or mA"):
        assign(recording, input="load", output="theta", current="shunt:V")


def test_the_reference_is_held_at_the_times_of_the_input_in_si_units() -> None:
    goal = Series(
        channel=Channel(name="goal", unit="deg"), values=np.array([0.0, 90.0]), t=np.array([0.0, 0.255])
    )
    recording = servo(DUTY, "1", np.ones(50))
    recording = Recording(name="servo", series=(*recording.series, goal), source=recording.source)

    data = measure(assign(recording, input="load", output="theta", reference="goal"))

    assert data.reference is not None
    np.testing.assert_allclose(data.reference, np.where(T < 0.255, 0.0, np.pi / 2), rtol=1e-15)
