"""Data sheets: the figures that follow from them are published elsewhere."""

from __future__ import annotations

from dataclasses import replace

import pytest

from servobench.core.errors import UnknownName, UsageError
from servobench.identification.models.nominal import nominal_values
from servobench.rig.motor.parameters import DATA_SHEETS, QUBE_SERVO_2, QUBE_SERVO_3, data_sheet
from servobench.rig.motor.physics import Physics


def test_qube_servo_2_with_its_rotor_has_the_time_constant_of_its_data_sheet() -> None:
    motor = replace(QUBE_SERVO_2.motor, inductance=0.0)
    # R J / k² with J = 2.0952e-5 kg·m²: 0.0998 s; 1/k = 23.81 rad/(s·V).
    assert nominal_values(motor)["time_constant"] == pytest.approx(0.0998, abs=5e-5)
    assert nominal_values(motor)["gain"] == pytest.approx(23.81, abs=5e-3)


def test_leaving_the_rotor_out_as_the_paper_does_gives_0_0807_s() -> None:
    motor = replace(QUBE_SERVO_2.motor, inductance=0.0, rotor_inertia=0.0)
    assert nominal_values(motor)["time_constant"] == pytest.approx(0.0807, abs=5e-5)


def test_qube_servo_3_has_a_time_constant_of_0_0773_s() -> None:
    motor = replace(QUBE_SERVO_3.motor, inductance=0.0)
    assert nominal_values(motor)["time_constant"] == pytest.approx(0.0773, abs=5e-5)


@pytest.mark.parametrize("name", sorted(DATA_SHEETS))
def test_every_value_of_a_data_sheet_has_its_source(name: str) -> None:
    sheet = data_sheet(name)
    friction = {"viscous_friction", "coulomb_torque"}
    values = {*vars(sheet.motor), "voltage_limit", "dead_band", "counts_per_rev", "counter_bits"} - friction
    assert values == set(sheet.sources)


@pytest.mark.parametrize("name", sorted(DATA_SHEETS))
def test_nominal_values_agree_with_the_eigenvalues_of_the_physics(name: str) -> None:
    """Two routes: the roots of the characteristic polynomial in the models, a matrix's eigenvalues in the motor."""
    motor = replace(data_sheet(name).motor, viscous_friction=3e-6, coulomb_torque=5e-4)
    physics = Physics.of(motor)
    nominal = nominal_values(motor)
    assert nominal["gain"] == pytest.approx(physics.gain, rel=1e-12)
    assert nominal["time_constant"] == pytest.approx(physics.time_constant, rel=1e-9)
    assert nominal["delay"] == pytest.approx(-1 / physics.eigenvalues[1].real, rel=1e-9)
    assert nominal["coulomb_voltage"] == pytest.approx(physics.coulomb_voltage, rel=1e-12)


def test_an_unknown_data_sheet_is_refused_with_the_known_names() -> None:
    with pytest.raises(UnknownName, match=r"qube_servo_2.*qube_servo_3"):
        data_sheet("qube_servo_9")


@pytest.mark.parametrize(
    ("name", "value"), [("resistance", 0.0), ("motor_constant", -1.0), ("inductance", float("nan"))]
)
def test_a_value_that_no_motor_has_is_refused_by_name(name: str, value: float) -> None:
    with pytest.raises(UsageError, match=name):
        replace(QUBE_SERVO_2.motor, **{name: value})
