"""The part of `HIL` that tells what a board is."""

from __future__ import annotations

from typing import Any

from servobench.compat.quanser.board import Board
from servobench.compat.quanser.buffers import DOUBLE, INT, output, values, whole_number
from servobench.compat.quanser.card import Card
from servobench.compat.quanser.enumerations import IntegerProperty, StringProperty
from servobench.compat.quanser.errors import Code, hil_error

_TEXTS = {
    StringProperty.MANUFACTURER: "servobench (stand-in)",
    StringProperty.SERIAL_NUMBER: "simulated",
    StringProperty.FIRMWARE_VERSION: "0.0 (stand-in)",
}


def _integers(board: Board) -> dict[int, int]:
    """The whole numbers that the stand-in knows of a board; identities and versions of real ones are 0."""
    layout = board.layout
    counted = {
        IntegerProperty.NUMBER_OF_ANALOG_INPUTS: layout.analog_inputs,
        IntegerProperty.NUMBER_OF_ENCODER_INPUTS: layout.encoders,
        IntegerProperty.NUMBER_OF_DIGITAL_INPUTS: layout.digital_inputs,
        IntegerProperty.NUMBER_OF_OTHER_INPUTS: len(layout.other_inputs),
        IntegerProperty.NUMBER_OF_ANALOG_OUTPUTS: layout.analog_outputs,
        IntegerProperty.NUMBER_OF_PWM_OUTPUTS: layout.pwm_outputs,
        IntegerProperty.NUMBER_OF_DIGITAL_OUTPUTS: layout.digital_outputs,
        IntegerProperty.NUMBER_OF_OTHER_OUTPUTS: len(layout.other_outputs),
        IntegerProperty.NUMBER_OF_CLOCKS: 1,
        IntegerProperty.NUMBER_OF_INTERRUPTS: 0,
    }
    return dict.fromkeys(range(IntegerProperty.NUMBER_OF_ANALOG_INPUTS), 0) | counted


def _text(board: Board, code: int) -> str:
    texts = {
        **_TEXTS,
        StringProperty.PRODUCT_NAME: f"{board.layout.title} (stand-in)",
        StringProperty.MODEL_NAME: board.address.card_type,
    }
    if code not in texts:
        raise hil_error(Code.INVALID_ARGUMENT, f"there is no text property {code}.")
    return texts[code]


class Properties(Card):
    """A board that tells what it is."""

    def get_integer_property(self, properties: Any, num_properties: Any, buffer: Any) -> None:
        """Fetch properties that are whole numbers."""
        board = self._board()
        count = whole_number(num_properties, "num_properties")
        numbers = values(properties, count, INT, "properties", Code.INVALID_ARGUMENT)
        target = output(buffer, count, INT, "property buffer", Code.INVALID_ARGUMENT)
        with board.call(guarded=False):
            known = _integers(board)
            for code in numbers:
                if code not in known:
                    raise hil_error(Code.INVALID_ARGUMENT, f"there is no whole-number property {code}.")
            target.fill(known[code] for code in numbers)

    def get_double_property(self, properties: Any, num_properties: Any, buffer: Any) -> None:
        """Fetch properties that are other numbers; a QUBE has none."""
        count = self._count(properties, num_properties)
        output(buffer, count, DOUBLE, "property buffer", Code.INVALID_ARGUMENT)
        if count:
            raise hil_error(Code.INVALID_ARGUMENT, "a QUBE has no such properties.")

    def get_string_property(self, property_code: Any, buffer: Any, buffer_size: Any = None) -> str | None:
        """Fetch a property that is a text, in either form.

        With a size in the place of the buffer the text is returned; with a buffer, its characters go there.
        """
        board = self._board()
        size = whole_number(buffer if buffer_size is None else buffer_size, "buffer_size")
        with board.call(guarded=False):
            text = _text(board, whole_number(property_code, "property_code"))
        if len(text) >= size:
            raise hil_error(Code.STRING_TOO_SMALL, f"{len(text) + 1} characters are needed.")
        if buffer_size is None:
            return text
        if isinstance(buffer, list):
            buffer[:] = text
        else:
            room = memoryview(buffer).cast("B")
            if len(room) <= len(text):
                raise hil_error(
                    Code.STRING_TOO_SMALL, f"the buffer has {len(room)} bytes; {len(text) + 1} are needed."
                )
            room[: len(text) + 1] = text.encode() + b"\0"
        return None

    def set_integer_property(self, properties: Any, num_properties: Any, buffer: Any) -> None:
        """Set properties that are whole numbers; a QUBE has none that can be set."""
        if self._count(properties, num_properties):
            raise hil_error(Code.INVALID_ARGUMENT, "a QUBE has no properties that can be set.")

    def set_double_property(self, properties: Any, num_properties: Any, buffer: Any) -> None:
        """Set properties that are other numbers; a QUBE has none."""
        self.set_integer_property(properties, num_properties, buffer)

    def set_string_property(self, property_code: Any, buffer: Any, buffer_size: Any) -> None:
        """Set a property that is a text; a QUBE has none that can be set."""
        self._board()
        raise hil_error(Code.INVALID_ARGUMENT, "a QUBE has no properties that can be set.")

    def _count(self, properties: Any, num_properties: Any) -> int:
        self._board()
        count = whole_number(num_properties, "num_properties")
        return len(values(properties, count, INT, "properties", Code.INVALID_ARGUMENT))
