"""Every parameter has its name in words and its symbol in one table."""

import re

import pytest

from servobench.core.parameter_names import PARAMETER_NAMES, parameter_in_words, parameter_symbol
from servobench.identification.models.base import STRUCTURES
from servobench.identification.models.nominal import nominal_values
from servobench.identification.motor_parameters.observation import UNITS
from servobench.rig.motor.parameters import QUBE_SERVO_2
from tests.datasets import dataset
from tests.test_architecture import PACKAGE

OF_FAMILIES = (
    "first_order_asymmetric_stribeck_gravity_load",
    "first_order_one_way_gravity",
    "rational_3_1_delay",
    "rational_2_0_integrator",
)
DATA = dataset(seed=1, samples=500, chain="derivative | lowpass 50 rad/s")
GUESSED = re.compile(r"""replace\(\s*(["'])_\1,\s*(["']) \2\s*\)""")


def test_underscores_become_spaces_in_one_place() -> None:
    found = {
        path.relative_to(PACKAGE).as_posix(): len(GUESSED.findall(path.read_text(encoding="utf-8")))
        for path in PACKAGE.rglob("*.py")
    }

    assert {path: count for path, count in found.items() if count} == {"core/parameter_names.py": 1}


@pytest.mark.parametrize("structure", [*STRUCTURES.names(), *OF_FAMILIES])
def test_every_parameter_of_a_structure_has_a_symbol(structure: str) -> None:
    parameters = (*STRUCTURES[structure].parameters, *STRUCTURES[structure].nuisance(DATA))

    assert [each.name for each in parameters if not parameter_symbol(each.name)] == []


@pytest.mark.parametrize("name", [*UNITS, *nominal_values(QUBE_SERVO_2.motor)])
def test_every_parameter_of_the_motor_has_a_row(name: str) -> None:
    assert name in PARAMETER_NAMES


@pytest.mark.parametrize("name", UNITS)
def test_the_table_says_what_the_motors_own_parameters_mean(name: str) -> None:
    assert PARAMETER_NAMES[name].meaning


@pytest.mark.parametrize("name", PARAMETER_NAMES)
def test_a_name_in_words_has_no_underscore(name: str) -> None:
    assert not set("_{}") & set(parameter_in_words(name))


@pytest.mark.parametrize(
    ("symbol", "words"),
    [
        ("V", "Coulomb voltage"),
        ("mV", "Coulomb voltage"),
        ("A", "Coulomb current"),
        ("%", "Coulomb duty"),
        ("N·m", "Coulomb torque"),
        ("1", "Coulomb input"),
        ("rad", "Coulomb input"),
        ("no unit", "Coulomb input"),
    ],
)
def test_friction_is_called_after_the_input(symbol: str, words: str) -> None:
    assert parameter_in_words("coulomb_voltage", symbol) == words


def test_a_number_at_the_end_stays() -> None:
    assert [(parameter_in_words(name), parameter_symbol(name)) for name in ("a2", "start_state_1")] == [
        ("a2", "a_2"),
        ("start state 1", "x_1"),
    ]


def test_a_plug_ins_own_parameter_is_its_words_and_has_no_symbol() -> None:
    assert parameter_in_words("cogging_torque_3") == "cogging torque 3"
    assert parameter_symbol("cogging_torque_3") == ""
