"""The part of `HIL` that opens and closes a board and sets it up."""

from __future__ import annotations

from typing import Any

import numpy as np

from servobench.compat.quanser import groups
from servobench.compat.quanser.board import Board
from servobench.compat.quanser.buffers import DOUBLE, INT, channels, finite, values, whole_number
from servobench.compat.quanser.enumerations import ENDLESS, ClockMode, PWMMode
from servobench.compat.quanser.errors import Code, hil_error
from servobench.compat.quanser.session import current


class Version:
    """The version of the interface: `major`, `minor`, `release` and `build`, and the `size` of the structure in C."""

    def __init__(self, size: int, major: int, minor: int, release: int, build: int) -> None:
        self.size, self.major, self.minor, self.release, self.build = size, major, minor, release, build


class Card:
    """A board that can be opened, closed and set up."""

    INFINITE = ENDLESS

    def __init__(self, card_type: Any = None, card_identifier: Any = None) -> None:
        self._card: Board | None = None
        if card_type is not None or card_identifier is not None:
            self.open(card_type, card_identifier)

    def _board(self) -> Board:
        """The board that is open; raises `HILError` where none is."""
        if self._card is None or self._card.ending is not None:
            raise hil_error(Code.INVALID_CARD)
        return self._card

    def open(self, card_type: Any, card_identifier: Any) -> None:
        """Open a board; one that was open is closed before."""
        self.close()
        self._card = current().open(card_type, card_identifier)

    def close(self) -> None:
        """Close the board; nothing happens where none is open."""
        if self._card is not None:
            if self._card.ending is None:
                current().close(self._card)
            self._card = None

    @staticmethod
    def close_all() -> None:
        """Close all boards of the program."""
        current().close_all(by_program=True)

    @staticmethod
    def get_version() -> Version:
        """Return the version of the interface that is stood in for."""
        return Version(12, 2, 15, 0, 0)

    def is_valid(self) -> bool:
        """Return whether a board is open."""
        return self._card is not None and self._card.ending is None

    def set_analog_input_configuration(self, channels: Any, num_channels: Any, configs: Any) -> None:
        """Choose how analog inputs are wired; those of a QUBE are as they are."""
        self._input_values(channels, num_channels, configs, INT)

    def set_analog_input_ranges(self, channels: Any, num_channels: Any, minima: Any, maxima: Any) -> None:
        """Choose the ranges of analog inputs; that of the current is ±3 A whatever is chosen."""
        lowest = self._input_values(channels, num_channels, minima, DOUBLE)
        highest = self._input_values(channels, num_channels, maxima, DOUBLE)
        _check_ranges(lowest, highest)

    def set_analog_output_ranges(self, channels: Any, num_channels: Any, minima: Any, maxima: Any) -> None:
        """Choose the ranges of analog outputs [V], at most those of the board."""
        board = self._board()
        count = self._output_count((channels, num_channels), 0)
        lowest, highest = (
            finite(values(limits, count, DOUBLE, "ranges", Code.INVALID_ARGUMENT), "range")
            for limits in (minima, maxima)
        )
        _check_ranges(lowest, highest)
        if count:
            board.output_limit = min(board.motion.limit, max(abs(lowest[-1]), abs(highest[-1])))

    def set_clock_mode(self, clocks: Any, num_clocks: Any, clock_modes: Any) -> None:
        """Choose what hardware clocks are for; they are time bases and nothing else."""
        self._board()
        count = len(channels(clocks, num_clocks, "clocks", Code.MISSING_CLOCKS))
        if any(
            mode != ClockMode.TIMEBASE
            for mode in values(clock_modes, count, INT, "modes", Code.INVALID_ARGUMENT)
        ):
            raise hil_error(Code.CLOCK_MODE_NOT_SUPPORTED)

    def set_digital_directions(
        self, input_channels: Any, num_input_channels: Any, output_channels: Any, num_output_channels: Any
    ) -> None:
        """Choose which digital channels are inputs and which are outputs; on a QUBE they are so by themselves."""
        self._input_count((input_channels, num_input_channels), 2)
        self._output_count((output_channels, num_output_channels), 2)

    def set_digital_output_configuration(self, channels: Any, num_channels: Any, configurations: Any) -> None:
        """Choose how digital outputs are driven; that of a QUBE drives both ways."""
        count = self._output_count((channels, num_channels), 2)
        values(configurations, count, INT, "configurations", Code.INVALID_ARGUMENT)

    def set_encoder_counts(self, channels: Any, num_channels: Any, counts: Any) -> None:
        """Let counters show these numbers from now on."""
        board, chosen = self._encoders(channels, num_channels)
        numbers = values(counts, len(chosen), INT, "counts", Code.MISSING_ENCODER_INPUT_BUFFER)
        with board.call():
            for channel, number in zip(chosen, numbers, strict=True):
                counter = board.motion.counters[channel]
                if not -counter.half_range <= number < counter.half_range:
                    raise hil_error(Code.OUT_OF_RANGE, f"{number} is beyond the range of counter {channel}.")
                counter.set(int(number), board.motion.angles[channel])

    def set_encoder_filter_frequency(self, channels: Any, num_channels: Any, frequencies: Any) -> None:
        """Choose the filters of encoder inputs [Hz]; simulated edges are clean, so that they make no difference."""
        _, chosen = self._encoders(channels, num_channels)
        for frequency in values(frequencies, len(chosen), DOUBLE, "frequencies", Code.INVALID_ARGUMENT):
            if not frequency > 0.0:
                raise hil_error(Code.FREQUENCY_NOT_POSITIVE, f"{frequency} Hz.")

    def set_encoder_quadrature_mode(self, channels: Any, num_channels: Any, modes: Any) -> None:
        """Choose how many edges of an encoder's lines are counted; without quadrature it is one."""
        board, chosen = self._encoders(channels, num_channels)
        mode_values = values(modes, len(chosen), INT, "modes", Code.INVALID_ARGUMENT)
        if any(mode not in (0, 1, 2, 4) for mode in mode_values):
            raise hil_error(Code.INVALID_ARGUMENT, "the quadrature mode is one of 0, 1, 2 and 4.")
        with board.call():
            for channel, mode in zip(chosen, mode_values, strict=True):
                board.motion.counters[channel].count_edges(max(int(mode), 1), board.motion.angles[channel])

    def set_pwm_mode(self, channels: Any, num_channels: Any, modes: Any) -> None:
        """Choose what values that are written to PWM outputs mean; here they are duty cycles."""
        count = self._output_count((channels, num_channels), 1)
        if any(
            mode != PWMMode.DUTY_CYCLE for mode in values(modes, count, INT, "modes", Code.INVALID_ARGUMENT)
        ):
            raise hil_error(Code.PWM_MODE_NOT_SUPPORTED)

    def set_pwm_configuration(
        self, channels: Any, num_channels: Any, configurations: Any, alignments: Any, polarities: Any
    ) -> None:
        """Choose how PWM outputs work together; the motor feels their mean alone."""
        count = self._output_count((channels, num_channels), 1)
        for codes in (configurations, alignments, polarities):
            values(codes, count, INT, "configurations", Code.INVALID_ARGUMENT)

    def set_pwm_deadband(
        self, channels: Any, num_channels: Any, leading_edge_deadband: Any, trailing_edge_deadband: Any
    ) -> None:
        """Choose the dead times of paired PWM outputs [s]; the motor feels the mean voltage alone."""
        count = self._output_count((channels, num_channels), 1)
        for dead_times in (leading_edge_deadband, trailing_edge_deadband):
            values(dead_times, count, DOUBLE, "dead times", Code.INVALID_ARGUMENT)

    def set_pwm_frequency(self, channels: Any, num_channels: Any, frequencies: Any) -> None:
        """Choose the frequency of PWM outputs [Hz]; the motor feels their mean alone."""
        board = self._board()
        count = self._output_count((channels, num_channels), 1)
        for frequency in values(frequencies, count, DOUBLE, "frequencies", Code.INVALID_ARGUMENT):
            if not frequency > 0.0:
                raise hil_error(Code.FREQUENCY_NOT_POSITIVE, f"{frequency} Hz.")
            board.pwm_frequency = float(frequency)

    def set_pwm_duty_cycle(self, channels: Any, num_channels: Any, duty_cycles: Any) -> None:
        """Choose the duty cycles of PWM outputs whose values mean something else; none do."""
        self._output_count((channels, num_channels), 1)
        raise hil_error(Code.PWM_MODE_NOT_SUPPORTED)

    def set_card_specific_options(self, options: Any, size: Any) -> None:
        """Set what is special to a board: `name=value;name=value`, of which `size` characters count."""
        board = self._board()
        text = options.decode() if isinstance(options, bytes) else options
        with board.call():
            board.set_options(text[: whole_number(size, "the size of the options")])

    def _encoders(self, channels: Any, count: Any) -> tuple[Board, tuple[int, ...]]:
        board = self._board()
        return board, groups.inputs(board.layout, groups.one_group(1, channels, count)).second

    def _input_count(self, channels: tuple[Any, Any], place: int) -> int:
        board = self._board()
        return len(tuple(groups.inputs(board.layout, groups.one_group(place, *channels)))[place])

    def _output_count(self, channels: tuple[Any, Any], place: int) -> int:
        board = self._board()
        return len(
            tuple(groups.outputs(board.layout, groups.one_group(place, *channels), pwm=board.pwm))[place]
        )

    def _input_values(self, channels: Any, count: Any, buffer: Any, kind: Any) -> Any:
        number = self._input_count((channels, count), 0)
        return values(buffer, number, kind, "values", Code.INVALID_ARGUMENT)


def _check_ranges(lowest: Any, highest: Any) -> None:
    if not np.all(np.asarray(lowest) < np.asarray(highest)):
        raise hil_error(Code.OUT_OF_RANGE, "the lower end of a range has to lie below the upper one.")
