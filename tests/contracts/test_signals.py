"""Every signal, including those of later files and plug-ins."""

import math
import pickle  # noqa: TID251 - a process that runs the loop gets its experiment this way
from typing import Any, get_args

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError
from pydantic.fields import FieldInfo

from servobench.core.settings import In, Settings, with_units
from servobench.systems.signals.base import SIGNALS, AnySignal, Signal

ANY_SIGNAL: TypeAdapter[Signal] = TypeAdapter(AnySignal)


def example(name: str, **changes: object) -> Any:
    """Return the member of that name with its defaults, and an example for each field that has none."""
    member = SIGNALS[name]
    fields: dict[str, FieldInfo] = member.model_fields  # type: ignore[attr-defined]
    given = {
        key: field.examples[0] for key, field in fields.items() if field.is_required() and field.examples
    }
    return member(**(given | changes))


def times(low: float, high: float, count: int = 500) -> np.ndarray:
    """Return random times [s]; an edge is met by none of them."""
    return np.random.default_rng(1).uniform(low, high, count)


NAMES = SIGNALS.names()
PERIODIC = [name for name in NAMES if example(name).period is not None]
STARTING = [name for name in NAMES if "start" in SIGNALS[name].model_fields]  # type: ignore[attr-defined]


@pytest.fixture(params=NAMES)
def name(request: pytest.FixtureRequest) -> str:
    return request.param


def test_it_is_a_frozen_signal_with_settings(name: str) -> None:
    signal = example(name)

    assert isinstance(signal, Signal)
    assert isinstance(signal, Settings)
    field = next(iter(type(signal).model_fields))
    with pytest.raises(ValidationError, match="frozen"):
        setattr(signal, field, 1.0)


def test_a_value_is_given_for_each_time_and_is_finite(name: str) -> None:
    t = np.concatenate([times(-100, 1000), [0.0, -0.0, 1e6, -1e6]])

    u = example(name)(t)

    assert u.shape == t.shape
    assert u.dtype == np.float64
    assert np.isfinite(u).all()


def test_no_times_give_no_values(name: str) -> None:
    assert example(name)(np.array([])).shape == (0,)


def test_it_is_a_function_of_time_alone(name: str) -> None:
    signal, t = example(name), times(-2, 30)
    before = t.copy()

    first, second = signal(t), example(name)(t[::-1])[::-1]

    np.testing.assert_array_equal(t, before)
    np.testing.assert_array_equal(first, signal(t))
    # Another order, another stride: another code path of the vectorised cosine, so up to a few last digits.
    np.testing.assert_allclose(first, second, rtol=0, atol=1e-12)


def test_a_record_is_what_its_times_give_one_by_one(name: str) -> None:
    signal = example(name)
    t = np.arange(200) * 0.05  # many edges among them

    one_by_one = np.array([signal(t[k : k + 1])[0] for k in range(len(t))])

    np.testing.assert_allclose(signal(t), one_by_one, rtol=0, atol=1e-12)


@pytest.mark.parametrize("periods", [1, 7, 1000])
@pytest.mark.parametrize("name", PERIODIC)
def test_it_repeats_after_its_period(name: str, periods: int) -> None:
    signal = example(name)
    t = times(0, 3 * signal.period)

    # The time is off by up to eps · (1000 · 10 s), the steepest signal turns by 2π · 10 Hz · 3 V: 1e-9 V, tenfold.
    np.testing.assert_allclose(signal(t + periods * signal.period), signal(t), rtol=0, atol=1e-8)


@pytest.mark.parametrize("name", PERIODIC)
def test_it_repeats_after_nothing_less_than_its_period(name: str) -> None:
    signal = example(name)
    t = times(0, 3 * signal.period)

    for part in (2, 3, 5, 7):
        assert not np.allclose(signal(t + signal.period / part), signal(t), rtol=0, atol=1e-3)


def test_its_shortest_change_is_a_time(name: str) -> None:
    shortest = example(name).shortest_change

    assert shortest is None or 0 < shortest < math.inf


@pytest.mark.parametrize("name", STARTING)
def test_before_its_start_it_rests_and_from_then_on_it_is_shifted(name: str) -> None:
    now, later = example(name, start=0.0), example(name, start="1.5 s")
    t = times(0, 40)

    assert np.ptp(later(times(-50, 1.5))) == 0
    np.testing.assert_allclose(later(t + 1.5), now(t), rtol=0, atol=1e-9)


def test_it_can_be_sent_to_another_process(name: str) -> None:
    signal = example(name)

    assert pickle.loads(pickle.dumps(signal)) == signal


def test_it_reads_back_from_what_it_is_written_as(name: str) -> None:
    signal = example(name)

    assert ANY_SIGNAL.validate_python({"type": name, **signal.model_dump()}) == signal
    assert ANY_SIGNAL.validate_python({"type": name, **with_units(signal)}) == signal
    assert ANY_SIGNAL.validate_json(ANY_SIGNAL.dump_json(signal)) == signal
    assert ANY_SIGNAL.dump_python(signal)["type"] == name


def test_each_field_says_what_it_is_and_in_which_unit(name: str) -> None:
    for key, field in SIGNALS[name].model_fields.items():  # type: ignore[attr-defined]
        assert field.description, f"{name}.{key} has no docstring"
        for unit in units_of(field):
            assert field.description.endswith(f"[{unit}]."), f"{name}.{key} doesn't name its unit, {unit}"


def units_of(field: FieldInfo) -> set[str]:
    """Return the units of the quantities in a field."""
    found = {mark.si for mark in field.metadata if isinstance(mark, In)}
    for argument in get_args(field.annotation):
        found |= {mark.si for mark in getattr(argument, "__metadata__", ()) if isinstance(mark, In)}
    return found


def test_an_unknown_setting_is_refused_and_the_known_ones_are_named(name: str) -> None:
    with pytest.raises(ValidationError, match="not known here") as caught:
        ANY_SIGNAL.validate_python({"type": name, "strat": 1})
    assert all(key in str(caught.value) for key in SIGNALS[name].model_fields)  # type: ignore[attr-defined]
