"""MuJoCo: a joint with the motor's armature inertia, damping and friction, and an actuator that takes the voltage.

J dω/dt = D K u - D ω - D K u_c sgn ω, with D = J/τ: the record only determines the ratios, so the user has to state an inertia;
the motion is the same for any. It follows from τ dω/dt = -ω + K (u - u_c sgn ω), times D.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar
from xml.sax.saxutils import escape

from servobench.core.errors import UsageError
from servobench.export.base import TARGETS, Wishes
from servobench.export.first_order import first_order_motor
from servobench.export.summary import ResultSummary

_TEXT = """\
<mujoco model="{stem}">
  <!--
{comment}
    gain {gain} {position}/(s·V), 95 % interval {gain_low} to {gain_high}
    time constant {tau} s, 95 % interval {tau_low} to {tau_high}
    The inertia {inertia} {inertia_unit} was given by the user: voltage and motion determine only ratios to it.
    MuJoCo has no delay: add the motor's {delay} s in your controller.{offset}
    Armature, damping and friction loss belong to the motor; the body's own inertia is negligible.
  -->
  <option timestep="{timestep}" integrator="implicitfast" gravity="0 0 0"/>
  <worldbody>
    <body name="shaft">
      <joint name="motor" type="{kind}" axis="0 0 1" armature="{inertia}" damping="{damping}" frictionloss="{friction}"/>
      <inertial pos="0 0 0" mass="{tiny}" diaginertia="{tiny} {tiny} {tiny}"/>
    </body>
  </worldbody>
  <actuator>
    <general name="voltage" joint="motor" gaintype="fixed" gainprm="{torque_per_volt}" biastype="none"{range}/>
  </actuator>
  <sensor>
    <jointpos name="position" joint="motor"/>
    <jointvel name="speed" joint="motor"/>
  </sensor>
</mujoco>
"""
_TINY = 1e-9  # of the armature: a body must have some inertia


@TARGETS.member("mujoco")
class Mujoco:
    """An MJCF file with one joint that moves as the motor does; `inertia=...` says how much turns."""

    suffix: ClassVar[str] = ".xml"
    wishes: ClassVar[frozenset[str]] = frozenset({"inertia", "sample_time"})

    def render(self, answer: ResultSummary, wishes: Wishes, stem: str) -> Mapping[str, bytes]:
        """Return the one file.

        Raises `UsageError` without an inertia, for a motor that isn't of first order, not driven by a voltage, or whose position
        is in counts.
        """
        position, _ = answer.units
        kinds = {"rad": ("hinge", "kg·m²"), "m": ("slide", "kg")}
        if position not in kinds:
            raise UsageError(f"mujoco takes positions in rad or m, and this result has them in {position}")
        motor = first_order_motor(answer, "mujoco")
        inertia = (answer.document.get("motor_parameters") or {}).get("inertia")
        if wishes.inertia is None and inertia is not None:
            raise UsageError(
                f"mujoco needs the inertia of all that moves; this result has one: give `inertia={inertia['value']:.4g}` "
                f"({kinds[position][1]})"
            )
        if wishes.inertia is None:
            raise UsageError(
                "mujoco needs an inertia, which voltage and motion alone don't determine: give `inertia=...`, such "
                f"as `inertia=2.1e-5` ({kinds[position][1]}, of all that moves)"
            )
        damping = wishes.inertia / motor.time_constant.value
        torque_per_volt = damping * motor.gain.value
        friction = motor.coulomb_voltage.value if motor.coulomb_voltage is not None else 0.0
        offset = motor.offset_voltage.value if motor.offset_voltage is not None else 0.0
        low, high = answer.input_range
        text = _TEXT.format(
            stem=escape(stem, {'"': "&quot;"}),
            comment="\n".join(f"    {line}" for line in _comment(answer)),
            gain=repr(motor.gain.value),
            gain_low=repr(motor.gain.interval[0]),
            gain_high=repr(motor.gain.interval[1]),
            tau=repr(motor.time_constant.value),
            tau_low=repr(motor.time_constant.interval[0]),
            tau_high=repr(motor.time_constant.interval[1]),
            position=position,
            inertia=repr(wishes.inertia),
            inertia_unit=kinds[position][1],
            delay=repr(answer.model.delay),
            offset=f"\n    Subtract the offset of {offset!r} V from the control." if offset else "",
            timestep=repr(wishes.sample_time or 0.001),
            kind=kinds[position][0],
            damping=repr(damping),
            friction=repr(max(abs(torque_per_volt) * friction, 0.0)),
            torque_per_volt=repr(torque_per_volt),
            tiny=repr(max(_TINY * wishes.inertia, 1e-14)),
            range=f' ctrlrange="{min(low, -high)!r} {max(high, -low)!r}"' if max(high, -low) > 0 else "",
        )
        return {f"{stem}.xml": text.encode()}


def _comment(answer: ResultSummary) -> list[str]:
    """The comment's lines, as they may stand in XML, where two hyphens end nothing well."""
    return [escape(line).replace("--", "- -") for line in answer.model_comment]
