"""The part of `HIL` that reads and writes at once."""

from __future__ import annotations

from typing import Any

import numpy as np

from servobench.compat.quanser import groups
from servobench.compat.quanser.board import CODES, Board
from servobench.compat.quanser.buffers import INT, output, values
from servobench.compat.quanser.card import Card
from servobench.compat.quanser.errors import Code
from servobench.compat.quanser.groups import GroupChannels


def _read(board: Board, channels: GroupChannels, arrays: tuple[Any, ...]) -> None:
    chosen = groups.inputs(board.layout, channels)
    buffers = groups.results(chosen, arrays)
    with board.call():
        groups.fill(buffers, [board.latch(chosen)])


def _write(board: Board, channels: GroupChannels, arrays: tuple[Any, ...]) -> None:
    chosen = groups.outputs(board.layout, channels, pwm=board.pwm)
    row = groups.rows(chosen, arrays)[0]
    with board.call():
        board.put(chosen, row)


def _read_write(
    board: Board,
    in_channels: GroupChannels,
    out_channels: GroupChannels,
    arrays: tuple[Any, ...],
    output_arrays: tuple[Any, ...],
) -> None:
    """Read, then write, in one call."""
    inputs = groups.inputs(board.layout, in_channels)
    outputs = groups.outputs(board.layout, out_channels, pwm=board.pwm)
    buffers, row = groups.results(inputs, arrays), groups.rows(outputs, output_arrays)[0]
    with board.call():
        groups.fill(buffers, [board.latch(inputs)])
        board.put(outputs, row)


class Immediate(Card):
    """A board that is read and written at once."""

    def _exchange(
        self,
        place: int,
        inputs: tuple[Any, Any],
        outputs: tuple[Any, Any],
        input_buffer: Any,
        output_buffer: Any,
    ) -> None:
        """Read inputs, then write outputs, each of one group: channels and their number."""
        asked, wanted = groups.one_group(place, *inputs), groups.one_group(place, *outputs)
        arrays = groups.one_array(place, input_buffer), groups.one_array(place, output_buffer)
        _read_write(self._board(), asked, wanted, *arrays)

    def read_analog(self, channels: Any, num_channels: Any, buffer: Any) -> None:
        """Read analog inputs: channel 0 is the motor's current [A]."""
        _read(self._board(), groups.one_group(0, channels, num_channels), groups.one_array(0, buffer))

    def read_analog_codes(self, channels: Any, num_channels: Any, buffer: Any) -> None:
        """Read analog inputs as the converter gives them."""
        board = self._board()
        chosen = groups.inputs(board.layout, groups.one_group(0, channels, num_channels))
        target = output(buffer, len(chosen.analog), INT, "analog buffer", Code.MISSING_ANALOG_INPUT_BUFFER)
        with board.call():
            target.fill(round(current / board.motion.current_step) for current in board.latch(chosen)[0])

    def read_encoder(self, channels: Any, num_channels: Any, buffer: Any) -> None:
        """Read encoders [counts]: 0 is the motor's, 1 the pendulum's."""
        _read(self._board(), groups.one_group(1, channels, num_channels), groups.one_array(1, buffer))

    def read_digital(self, channels: Any, num_channels: Any, buffer: Any) -> None:
        """Read digital inputs: the amplifier's fault, the warning and the error of a stall."""
        _read(self._board(), groups.one_group(2, channels, num_channels), groups.one_array(2, buffer))

    def read_other(self, channels: Any, num_channels: Any, buffer: Any) -> None:
        """Read other inputs: the tachometers [counts/s]."""
        _read(self._board(), groups.one_group(3, channels, num_channels), groups.one_array(3, buffer))

    def read(
        self,
        analog_channels: Any,
        num_analog_channels: Any,
        encoder_channels: Any,
        num_encoder_channels: Any,
        digital_channels: Any,
        num_digital_channels: Any,
        other_channels: Any,
        num_other_channels: Any,
        analog_buffer: Any,
        encoder_buffer: Any,
        digital_buffer: Any,
        other_buffer: Any,
    ) -> None:
        """Read inputs of all groups at one time."""
        channels = (
            (analog_channels, num_analog_channels),
            (encoder_channels, num_encoder_channels),
            (digital_channels, num_digital_channels),
            (other_channels, num_other_channels),
        )
        _read(self._board(), channels, (analog_buffer, encoder_buffer, digital_buffer, other_buffer))

    def write_analog(self, channels: Any, num_channels: Any, buffer: Any) -> None:
        """Write analog outputs: channel 0 is the motor's voltage [V]."""
        _write(self._board(), groups.one_group(0, channels, num_channels), groups.one_array(0, buffer))

    def write_analog_codes(self, channels: Any, num_channels: Any, buffer: Any) -> None:
        """Write analog outputs as their converter takes them."""
        board = self._board()
        chosen = groups.outputs(board.layout, groups.one_group(0, channels, num_channels), pwm=board.pwm)
        count = len(chosen.analog)
        codes = values(buffer, count, INT, "analog buffer", Code.MISSING_ANALOG_OUTPUT_BUFFER)
        _write(
            board,
            groups.one_group(0, channels, num_channels),
            groups.one_array(0, np.asarray(codes, np.float64) * 2 * board.motion.limit / CODES),
        )

    def write_pwm(self, channels: Any, num_channels: Any, buffer: Any) -> None:
        """Write duty cycles to PWM outputs, -1 to 1."""
        _write(self._board(), groups.one_group(1, channels, num_channels), groups.one_array(1, buffer))

    def write_digital(self, channels: Any, num_channels: Any, buffer: Any) -> None:
        """Write digital outputs: channel 0 turns the amplifier on."""
        _write(self._board(), groups.one_group(2, channels, num_channels), groups.one_array(2, buffer))

    def write_other(self, channels: Any, num_channels: Any, buffer: Any) -> None:
        """Write other outputs: the light, red, green and blue from 0 to 1."""
        _write(self._board(), groups.one_group(3, channels, num_channels), groups.one_array(3, buffer))

    def write(
        self,
        analog_channels: Any,
        num_analog_channels: Any,
        pwm_channels: Any,
        num_pwm_channels: Any,
        digital_channels: Any,
        num_digital_channels: Any,
        other_channels: Any,
        num_other_channels: Any,
        analog_buffer: Any,
        pwm_buffer: Any,
        digital_buffer: Any,
        other_buffer: Any,
    ) -> None:
        """Write outputs of all groups at one time."""
        channels = (
            (analog_channels, num_analog_channels),
            (pwm_channels, num_pwm_channels),
            (digital_channels, num_digital_channels),
            (other_channels, num_other_channels),
        )
        _write(self._board(), channels, (analog_buffer, pwm_buffer, digital_buffer, other_buffer))

    def read_analog_write_analog(
        self,
        input_channels: Any,
        num_input_channels: Any,
        output_channels: Any,
        num_output_channels: Any,
        input_buffer: Any,
        output_buffer: Any,
    ) -> None:
        """Read analog inputs, then write analog outputs."""
        inputs, outputs = (input_channels, num_input_channels), (output_channels, num_output_channels)
        self._exchange(0, inputs, outputs, input_buffer, output_buffer)

    def read_encoder_write_pwm(
        self,
        input_channels: Any,
        num_input_channels: Any,
        output_channels: Any,
        num_output_channels: Any,
        input_buffer: Any,
        output_buffer: Any,
    ) -> None:
        """Read encoders, then write PWM outputs."""
        inputs, outputs = (input_channels, num_input_channels), (output_channels, num_output_channels)
        self._exchange(1, inputs, outputs, input_buffer, output_buffer)

    def read_digital_write_digital(
        self,
        input_channels: Any,
        num_input_channels: Any,
        output_channels: Any,
        num_output_channels: Any,
        input_buffer: Any,
        output_buffer: Any,
    ) -> None:
        """Read digital inputs, then write digital outputs."""
        inputs, outputs = (input_channels, num_input_channels), (output_channels, num_output_channels)
        self._exchange(2, inputs, outputs, input_buffer, output_buffer)

    def read_other_write_other(
        self,
        input_channels: Any,
        num_input_channels: Any,
        output_channels: Any,
        num_output_channels: Any,
        input_buffer: Any,
        output_buffer: Any,
    ) -> None:
        """Read other inputs, then write other outputs."""
        inputs, outputs = (input_channels, num_input_channels), (output_channels, num_output_channels)
        self._exchange(3, inputs, outputs, input_buffer, output_buffer)

    def read_write(
        self,
        analog_input_channels: Any,
        num_analog_input_channels: Any,
        encoder_input_channels: Any,
        num_encoder_input_channels: Any,
        digital_input_channels: Any,
        num_digital_input_channels: Any,
        other_input_channels: Any,
        num_other_input_channels: Any,
        analog_output_channels: Any,
        num_analog_output_channels: Any,
        pwm_output_channels: Any,
        num_pwm_output_channels: Any,
        digital_output_channels: Any,
        num_digital_output_channels: Any,
        other_output_channels: Any,
        num_other_output_channels: Any,
        analog_input_buffer: Any,
        encoder_input_buffer: Any,
        digital_input_buffer: Any,
        other_input_buffer: Any,
        analog_output_buffer: Any,
        pwm_output_buffer: Any,
        digital_output_buffer: Any,
        other_output_buffer: Any,
    ) -> None:
        """Read inputs of all groups, then write outputs of all groups."""
        in_channels = (
            (analog_input_channels, num_analog_input_channels),
            (encoder_input_channels, num_encoder_input_channels),
            (digital_input_channels, num_digital_input_channels),
            (other_input_channels, num_other_input_channels),
        )
        out_channels = (
            (analog_output_channels, num_analog_output_channels),
            (pwm_output_channels, num_pwm_output_channels),
            (digital_output_channels, num_digital_output_channels),
            (other_output_channels, num_other_output_channels),
        )
        arrays = (analog_input_buffer, encoder_input_buffer, digital_input_buffer, other_input_buffer)
        output_arrays = (analog_output_buffer, pwm_output_buffer, digital_output_buffer, other_output_buffer)
        _read_write(self._board(), in_channels, out_channels, arrays, output_arrays)
