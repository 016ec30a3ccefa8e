"""The boards that the stand-in knows: their channels and ranges, and what hangs on them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from servobench.compat.quanser.errors import Code, hil_error

LIGHTS = (11000, 11001, 11002)
TACHOMETER, PENDULUM_TACHOMETER = 14000, 14001
_ADDRESS = re.compile(r"(?P<number>\d+)@tcpip://(localhost|127\.0\.0\.1):(?P<port>\d+)(\?.*)?")


@dataclass(frozen=True, kw_only=True)
class Layout:
    """A type of board: its `title` for people, its channels, and the `largest_voltage` that it puts out [V].

    `data_sheet` names the motor of that generation. There are so many `analog_inputs`, `analog_outputs`, `encoders`,
    `digital_inputs`, `digital_outputs` and `pwm_outputs`; `other_inputs` and `other_outputs` have numbers of their own.
    """

    title: str
    data_sheet: str
    analog_inputs: int = 1
    analog_outputs: int = 1
    encoders: int = 2
    digital_inputs: int = 3
    digital_outputs: int = 1
    pwm_outputs: int = 0
    other_inputs: tuple[int, ...] = (TACHOMETER,)
    other_outputs: tuple[int, ...] = LIGHTS
    largest_voltage: float = 15.0
    ports: Mapping[int, bool] = field(default_factory=dict)
    """Ports of Quanser's simulator, and whether a pendulum is mounted there."""


LAYOUTS: Mapping[str, Layout] = MappingProxyType(
    {
        "qube_servo_usb": Layout(title="QUBE-Servo", data_sheet="qube_servo_2", largest_voltage=10.0),
        "qube_servo2_usb": Layout(
            title="QUBE-Servo 2",
            data_sheet="qube_servo_2",
            ports=MappingProxyType({18920: False, 18921: True}),
        ),
        "qube_servo3_usb": Layout(
            title="QUBE-Servo 3",
            data_sheet="qube_servo_3",
            pwm_outputs=1,
            other_inputs=(TACHOMETER, PENDULUM_TACHOMETER),
            ports=MappingProxyType({18922: False, 18923: True}),
        ),
    }
)


@dataclass(frozen=True)
class Address:
    """The board that is opened: its `card_type` and identifier, and whether it is one of Quanser's simulator, with a pendulum."""

    card_type: str
    identifier: str
    simulator: bool = False
    pendulum: bool = False


def find(card_type: object, identifier: object) -> Address:
    """Return the board of that type and identifier; raises `HILError` where there is none."""
    if not isinstance(card_type, str) or not isinstance(identifier, str):
        raise TypeError(
            f"a board's type and identifier are texts, such as 'qube_servo2_usb' and '0', not {identifier!r}"
        )
    if card_type not in LAYOUTS:
        raise hil_error(Code.UNKNOWN_CARD_TYPE, f"{card_type!r}; the stand-in knows {', '.join(LAYOUTS)}.")
    if identifier == "0":
        return Address(card_type, identifier)
    if not (matched := _ADDRESS.fullmatch(identifier)):
        raise hil_error(
            Code.BOARD_NOT_FOUND, f"{card_type} {identifier!r}; the stand-in has one, {card_type} '0'."
        )
    ports = LAYOUTS[card_type].ports
    port = int(matched["port"])
    if port not in ports:
        known = ", ".join(map(str, ports)) or "none"
        raise hil_error(Code.CANNOT_CONNECT, f"port {port}; a simulated {card_type} is at port {known}.")
    return Address(card_type, identifier, simulator=True, pendulum=ports[port])
