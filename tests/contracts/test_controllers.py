"""Every controller, including those of later files and plug-ins."""

import pickle  # noqa: TID251 - a process that runs the loop gets its experiment this way
from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from servobench.core.settings import In, Settings, with_units
from servobench.rig.experiment import Experiment, read_experiment
from servobench.rig.experiment.experiment import AnyController
from servobench.systems.control.base import CONTROLLERS, Controller
from tests.systems.control.laws import device, sample

ANY_CONTROLLER: TypeAdapter[Controller] = TypeAdapter(AnyController)
H = 0.002


@pytest.fixture(params=CONTROLLERS.names())
def name(request: pytest.FixtureRequest) -> str:
    return request.param


def example(name: str) -> Any:
    return CONTROLLERS[name]()


def test_it_is_a_frozen_controller_with_settings(name: str) -> None:
    law = example(name)

    assert isinstance(law, Controller)
    assert isinstance(law, Settings)
    with pytest.raises(ValidationError, match="frozen"):
        setattr(law, next(iter(type(law).model_fields), "gain"), 1.0)


def test_it_reads_back_from_what_it_is_written_as_in_a_file_too(name: str) -> None:
    law = example(name)

    assert ANY_CONTROLLER.validate_python({"type": name, **with_units(law)}) == law
    assert ANY_CONTROLLER.validate_json(ANY_CONTROLLER.dump_json(law)) == law
    assert pickle.loads(pickle.dumps(law)) == law
    asked = Experiment(controller=law)
    assert read_experiment(asked.to_toml()) == asked


def test_each_setting_says_what_it_is_and_in_which_unit(name: str) -> None:
    for key, field in CONTROLLERS[name].model_fields.items():  # type: ignore[attr-defined]
        assert field.description, f"{name}.{key} has no docstring"
        for mark in field.metadata:
            if isinstance(mark, In):
                assert field.description.endswith(f"[{mark.si}]."), f"{name}.{key} doesn't name {mark.si}"


def test_an_unknown_setting_is_refused_and_the_known_ones_are_named(name: str) -> None:
    with pytest.raises(ValidationError, match="not known here") as caught:
        ANY_CONTROLLER.validate_python({"type": name, "kpp": 1})
    assert all(key in str(caught.value) for key in CONTROLLERS[name].model_fields)  # type: ignore[attr-defined]


def test_a_state_is_a_value_that_a_step_does_not_change(name: str) -> None:
    law, info = example(name), device()
    state = law.start(H, info)
    for k in range(5):
        state, _ = law.step(state, 1.0, sample(k, 3 * k, H))

    first = [law.step(state, 0.5, sample(5, 20, H))[1] for _ in range(2)]

    assert first[0] == first[1]


@pytest.mark.promise("S38")
def test_with_feedback_it_takes_over_a_turning_motor_with_the_voltage_that_was_applied(name: str) -> None:
    law, info, now = example(name), device(), sample(1000, 123456, H)

    state = law.take_over(H, info, 2.5, now, -3.25)
    _, voltage = law.step(state, 2.5, now)

    # Without feedback the reference is the voltage that was asked for, and nothing else is put out.
    expected = 2.5 if law.reference_unit == "V" else -3.25
    # The voltage is a sum of terms as large as gain times position, 379 rad here: 10 roundings of that.
    assert voltage == pytest.approx(expected, abs=10 * 400 * np.finfo(float).eps)


def test_it_says_in_which_unit_its_reference_is(name: str) -> None:
    assert example(name).reference_unit in {"V", "rad", "rad/s"}
