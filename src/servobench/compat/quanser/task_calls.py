"""The part of `HIL` that makes and uses tasks."""

from __future__ import annotations

from typing import Any

from servobench.compat.quanser import groups
from servobench.compat.quanser.buffers import whole_number
from servobench.compat.quanser.card import Card
from servobench.compat.quanser.errors import Code, hil_error
from servobench.compat.quanser.groups import GroupChannels
from servobench.compat.quanser.tasks import (
    Groups,
    Pair,
    Task,
    parts,
    reader_of,
    require,
    writer_of,
)

_CLOCKS = range(-4, 1)  # four system clocks, and the hardware clock


class TaskCalls(Card):
    """A board whose inputs are sampled, and whose outputs are put out, at the ticks of a clock."""

    def _add(self, kind: Any, size: Any, chosen: Groups) -> Task:
        """Make a task, not yet started."""
        board = self._board()
        samples = whole_number(size, "samples_in_buffer")
        if samples <= 0:
            raise hil_error(Code.INVALID_BUFFER_SIZE, f"samples_in_buffer is {samples}.")
        task = Task(kind, chosen, samples, board.address.simulator, board.latch, board.put)
        with board.call():
            board.tasks.append(task)
        return task

    def _reader(self, size: Any, channels: GroupChannels) -> Task:
        return self._add("reader", size, groups.inputs(self._board().layout, channels))

    def _writer(self, size: Any, channels: GroupChannels) -> Task:
        board = self._board()
        return self._add("writer", size, groups.outputs(board.layout, channels, pwm=board.pwm))

    def task_create_analog_reader(self, samples_in_buffer: Any, channels: Any, num_channels: Any) -> Task:
        """Return a task that reads analog inputs."""
        return self._reader(samples_in_buffer, groups.one_group(0, channels, num_channels))

    def task_create_encoder_reader(self, samples_in_buffer: Any, channels: Any, num_channels: Any) -> Task:
        """Return a task that reads encoders."""
        return self._reader(samples_in_buffer, groups.one_group(1, channels, num_channels))

    def task_create_digital_reader(self, samples_in_buffer: Any, channels: Any, num_channels: Any) -> Task:
        """Return a task that reads digital inputs."""
        return self._reader(samples_in_buffer, groups.one_group(2, channels, num_channels))

    def task_create_other_reader(self, samples_in_buffer: Any, channels: Any, num_channels: Any) -> Task:
        """Return a task that reads other inputs."""
        return self._reader(samples_in_buffer, groups.one_group(3, channels, num_channels))

    def task_create_reader(
        self,
        samples_in_buffer: Any,
        analog_channels: Any,
        num_analog_channels: Any,
        encoder_channels: Any,
        num_encoder_channels: Any,
        digital_channels: Any,
        num_digital_channels: Any,
        other_channels: Any,
        num_other_channels: Any,
    ) -> Task:
        """Return a task that reads inputs of all groups."""
        channels = (
            (analog_channels, num_analog_channels),
            (encoder_channels, num_encoder_channels),
            (digital_channels, num_digital_channels),
            (other_channels, num_other_channels),
        )
        return self._reader(samples_in_buffer, channels)

    def task_create_analog_writer(self, samples_in_buffer: Any, channels: Any, num_channels: Any) -> Task:
        """Return a task that writes analog outputs."""
        return self._writer(samples_in_buffer, groups.one_group(0, channels, num_channels))

    def task_create_pwm_writer(self, samples_in_buffer: Any, channels: Any, num_channels: Any) -> Task:
        """Return a task that writes PWM outputs."""
        return self._writer(samples_in_buffer, groups.one_group(1, channels, num_channels))

    def task_create_digital_writer(self, samples_in_buffer: Any, channels: Any, num_channels: Any) -> Task:
        """Return a task that writes digital outputs."""
        return self._writer(samples_in_buffer, groups.one_group(2, channels, num_channels))

    def task_create_other_writer(self, samples_in_buffer: Any, channels: Any, num_channels: Any) -> Task:
        """Return a task that writes other outputs."""
        return self._writer(samples_in_buffer, groups.one_group(3, channels, num_channels))

    def task_create_writer(
        self,
        samples_in_buffer: Any,
        analog_channels: Any,
        num_analog_channels: Any,
        pwm_channels: Any,
        num_pwm_channels: Any,
        digital_channels: Any,
        num_digital_channels: Any,
        other_channels: Any,
        num_other_channels: Any,
    ) -> Task:
        """Return a task that writes outputs of all groups."""
        channels = (
            (analog_channels, num_analog_channels),
            (pwm_channels, num_pwm_channels),
            (digital_channels, num_digital_channels),
            (other_channels, num_other_channels),
        )
        return self._writer(samples_in_buffer, channels)

    def task_create_reader_writer(
        self,
        samples_in_buffer: Any,
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
    ) -> Pair:
        """Return a task that reads inputs and writes outputs at each tick."""
        reader = self.task_create_reader(
            samples_in_buffer,
            analog_input_channels,
            num_analog_input_channels,
            encoder_input_channels,
            num_encoder_input_channels,
            digital_input_channels,
            num_digital_input_channels,
            other_input_channels,
            num_other_input_channels,
        )
        writer = self.task_create_writer(
            samples_in_buffer,
            analog_output_channels,
            num_analog_output_channels,
            pwm_output_channels,
            num_pwm_output_channels,
            digital_output_channels,
            num_digital_output_channels,
            other_output_channels,
            num_other_output_channels,
        )
        return Pair(reader, writer)

    def task_set_buffer_overflow_mode(self, task: Any, mode: Any) -> None:
        """Say what happens where the buffer is full."""
        for part in parts(require(task)):
            part.set_mode(whole_number(mode, "the overflow mode"))

    def task_get_buffer_overflows(self, task: Any) -> int:
        """Return how many samples were lost, or missing, at ticks."""
        with self._board().call(0.0):
            return sum(part.overflows for part in parts(require(task)))

    def task_start(self, task: Any, clock: Any, frequency: Any, num_samples: Any) -> None:
        """Start to tick with a frequency [Hz], for a number of samples."""
        task_or_pair = require(task)
        if whole_number(clock, "clock") not in _CLOCKS:
            raise hil_error(Code.CLOCK_NOT_SUPPORTED, f"clock {clock}; a QUBE has hardware clock 0.")
        count = whole_number(num_samples, "num_samples")
        with self._board().call() as now:
            for part in parts(task_or_pair):
                part.start(now, float(frequency), count)

    def task_flush(self, task: Any) -> None:
        """Wait until everything was put out; of a reader, throw away what wasn't read."""
        for part in parts(require(task)):
            if part.kind == "reader":
                part.buffer.clear()
            else:
                self._wait_for_room(part, part.size)

    def task_stop(self, task: Any) -> None:
        """Stop to tick; the task can be started again."""
        task_or_pair = require(task)
        with self._board().call(guarded=False):
            for part in parts(task_or_pair):
                part.stop()

    def task_stop_all(self) -> None:
        """Stop all tasks of the board."""
        board = self._board()
        with board.call(guarded=False):
            for task in board.tasks:
                task.stop()

    def task_delete(self, task: Any) -> None:
        """Delete a task; one that runs is stopped."""
        board, task_or_pair = self._board(), require(task)
        with board.call(guarded=False):
            for part in parts(task_or_pair):
                part.stop()
                part.deleted = True
                board.tasks.remove(part)

    def task_delete_all(self) -> None:
        """Delete all tasks of the board."""
        for task in tuple(self._board().tasks):
            self.task_delete(task)

    def task_read_analog(self, task: Any, num_samples: Any, buffer: Any) -> int:
        """Wait for samples of analog inputs, and return how many there were."""
        return self.task_read(task, num_samples, buffer, None, None, None)

    def task_read_encoder(self, task: Any, num_samples: Any, buffer: Any) -> int:
        """Wait for samples of encoders, and return how many there were."""
        return self.task_read(task, num_samples, None, buffer, None, None)

    def task_read_digital(self, task: Any, num_samples: Any, buffer: Any) -> int:
        """Wait for samples of digital inputs, and return how many there were."""
        return self.task_read(task, num_samples, None, None, buffer, None)

    def task_read_other(self, task: Any, num_samples: Any, buffer: Any) -> int:
        """Wait for samples of other inputs, and return how many there were."""
        return self.task_read(task, num_samples, None, None, None, buffer)

    def task_read(
        self,
        task: Any,
        num_samples: Any,
        analog_buffer: Any,
        encoder_buffer: Any,
        digital_buffer: Any,
        other_buffer: Any,
    ) -> int:
        """Wait for samples, and return how many there were: fewer than wanted where the task stopped before."""
        reader, count = reader_of(task), whole_number(num_samples, "num_samples")
        if count > reader.size:
            raise hil_error(Code.TOO_MANY_SAMPLES, f"{count} of a buffer of {reader.size}.")
        arrays = (analog_buffer, encoder_buffer, digital_buffer, other_buffer)
        buffers = groups.results(reader.groups, arrays, count)
        board = self._board()
        while True:
            with board.call(0.0) as now:
                if reader.failed or reader.is_over() or len(reader.buffer) >= count:
                    rows = reader.take(count, now)
                    groups.fill(buffers, rows)
                    return len(rows)
                moment = min(reader.time_of(count), board.watchdog.expires)
            board.timebase.wait_until(moment)

    def task_write_analog(self, task: Any, num_samples: Any, buffer: Any) -> int:
        """Hand samples for analog outputs to a task, and return how many it took."""
        return self.task_write(task, num_samples, buffer, None, None, None)

    def task_write_pwm(self, task: Any, num_samples: Any, buffer: Any) -> int:
        """Hand samples for PWM outputs to a task, and return how many it took."""
        return self.task_write(task, num_samples, None, buffer, None, None)

    def task_write_digital(self, task: Any, num_samples: Any, buffer: Any) -> int:
        """Hand samples for digital outputs to a task, and return how many it took."""
        return self.task_write(task, num_samples, None, None, buffer, None)

    def task_write_other(self, task: Any, num_samples: Any, buffer: Any) -> int:
        """Hand samples for other outputs to a task, and return how many it took."""
        return self.task_write(task, num_samples, None, None, None, buffer)

    def task_write(
        self,
        task: Any,
        num_samples: Any,
        analog_buffer: Any,
        pwm_buffer: Any,
        digital_buffer: Any,
        other_buffer: Any,
    ) -> int:
        """Hand samples to a task, waiting for room in its buffer, and return how many it took."""
        writer, count = writer_of(task), whole_number(num_samples, "num_samples")
        if count > writer.size:
            raise hil_error(Code.TOO_MANY_SAMPLES, f"{count} into a buffer of {writer.size}.")
        rows = groups.rows(writer.groups, (analog_buffer, pwm_buffer, digital_buffer, other_buffer), count)
        if not self._wait_for_room(writer, count):
            return 0
        with self._board().call(0.0) as now:
            for row in rows:
                writer.give(row, now)
        return count

    def task_read_write(
        self,
        task: Any,
        num_samples: Any,
        analog_input_buffer: Any,
        encoder_input_buffer: Any,
        digital_input_buffer: Any,
        other_input_buffer: Any,
        analog_output_buffer: Any,
        pwm_output_buffer: Any,
        digital_output_buffer: Any,
        other_output_buffer: Any,
    ) -> int:
        """Wait for samples, then hand as many to the outputs."""
        self.task_write(
            task,
            num_samples,
            analog_output_buffer,
            pwm_output_buffer,
            digital_output_buffer,
            other_output_buffer,
        )
        return self.task_read(
            task,
            num_samples,
            analog_input_buffer,
            encoder_input_buffer,
            digital_input_buffer,
            other_input_buffer,
        )

    def _wait_for_room(self, writer: Task, count: int) -> bool:
        """Wait until a writer's buffer has room for samples; False where it ended before."""
        board = self._board()
        while True:
            with board.call(0.0):
                if writer.size - len(writer.buffer) >= count:
                    return not (writer.is_over() and writer.started)
                if writer.is_over():
                    return False
                moment = min(writer.time_of(count), board.watchdog.expires)
            board.timebase.wait_until(moment)
