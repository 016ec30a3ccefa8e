"""The part of `HIL` that runs the watchdog."""

from __future__ import annotations

from typing import Any

from servobench.compat.quanser import groups
from servobench.compat.quanser.board import Board
from servobench.compat.quanser.buffers import DOUBLE, INT, finite, values
from servobench.compat.quanser.card import Card
from servobench.compat.quanser.errors import Code, hil_error
from servobench.compat.quanser.layout import LIGHTS


class WatchdogCalls(Card):
    """A board with a watchdog; whether a real QUBE has one isn't known."""

    def _require_watchdog(self) -> Board:
        board = self._board()
        if not board.has_watchdog:
            raise hil_error(Code.FUNCTION_NOT_SUPPORTED, "This board has no watchdog.")
        return board

    def _outputs(self, place: int, channel_array: Any, count: Any) -> tuple[int, ...]:
        board = self._require_watchdog()
        channels = groups.one_group(place, channel_array, count)
        return tuple(groups.outputs(board.layout, channels, pwm=board.pwm))[place]

    def watchdog_set_analog_expiration_state(self, channels: Any, num_channels: Any, voltages: Any) -> None:
        """Choose the voltage that is put out when the watchdog expires [V]."""
        count = len(self._outputs(0, channels, num_channels))
        for voltage in finite(values(voltages, count, DOUBLE, "voltages", Code.INVALID_ARGUMENT), "voltage"):
            self._require_watchdog().watchdog.voltage = voltage

    def watchdog_set_pwm_expiration_state(self, channels: Any, num_channels: Any, duty_cycles: Any) -> None:
        """Choose the duty cycles for when the watchdog expires; they are 0 here, as on all boards that are known."""
        count = len(self._outputs(1, channels, num_channels))
        if any(values(duty_cycles, count, DOUBLE, "duty cycles", Code.INVALID_ARGUMENT)):
            raise hil_error(Code.NOT_SUPPORTED, "duty cycles other than 0 can't be chosen.")

    def watchdog_set_digital_expiration_state(self, channels: Any, num_channels: Any, states: Any) -> None:
        """Choose whether the amplifier is on when the watchdog has expired."""
        count = len(self._outputs(2, channels, num_channels))
        for state in values(states, count, INT, "states", Code.INVALID_ARGUMENT):
            if state not in range(4):
                raise hil_error(Code.INVALID_ARGUMENT, f"the state {state} isn't one of 0 to 3.")
            self._require_watchdog().watchdog.enabled = int(state)

    def watchdog_set_other_expiration_state(self, channels: Any, num_channels: Any, states: Any) -> None:
        """Choose the light for when the watchdog expires."""
        chosen = self._outputs(3, channels, num_channels)
        light_states = finite(values(states, len(chosen), DOUBLE, "states", Code.INVALID_ARGUMENT), "state")
        watchdog = self._require_watchdog().watchdog
        lights = dict(zip(LIGHTS, watchdog.lights, strict=True)) | dict(
            zip(chosen, light_states, strict=True)
        )
        watchdog.lights = tuple(lights[channel] for channel in LIGHTS)

    def watchdog_start(self, timeout: Any) -> None:
        """Let the watchdog expire after a time [s] unless it is reloaded."""
        board = self._require_watchdog()
        with board.call() as now:
            board.watchdog.start(float(timeout), now)

    def watchdog_reload(self) -> bool:
        """Reload the watchdog, and return whether that was in time."""
        board = self._require_watchdog()
        with board.call(guarded=False) as now:
            return board.watchdog.reload(now)

    def watchdog_is_expired(self) -> bool:
        """Return whether the watchdog has expired."""
        board = self._require_watchdog()
        with board.call(guarded=False):
            return board.watchdog.expired

    def watchdog_clear(self) -> None:
        """Allow access again after the watchdog has expired."""
        board = self._require_watchdog()
        with board.call(guarded=False) as now:
            board.clear_watchdog(now)

    def watchdog_stop(self) -> None:
        """Stop the watchdog; it isn't cleared."""
        board = self._require_watchdog()
        with board.call(guarded=False):
            board.watchdog.stop()
