"""A watchdog that is reloaded for a while, then starved: the motor coasts to rest, and the board refuses access."""

import time

import numpy as np
from quanser.hardware import HIL, DigitalState, HILError

one, counts = np.array([0], dtype=np.uint32), np.zeros(1, dtype=np.int32)


def speed(card):
    found = np.zeros(1)
    card.read_other(np.array([14000], dtype=np.uint32), 1, found)
    return found[0] * 2 * np.pi / 2048


card = HIL("qube_servo2_usb", "0")
card.watchdog_set_analog_expiration_state(one, 1, np.zeros(1))
card.watchdog_set_digital_expiration_state(one, 1, np.array([DigitalState.TRISTATE], dtype=np.int32))
card.write_digital(one, 1, np.array([1], dtype=np.int8))
card.watchdog_start(0.1)
card.write_analog(one, 1, np.array([3.0]))
for _ in range(50):
    time.sleep(0.02)
    if not card.watchdog_reload():
        print("Unable to reload.")
print(f"fed: {speed(card):.0f} rad/s")
time.sleep(1.5)
try:
    card.write_analog(one, 1, np.array([3.0]))
except HILError:
    print("refused")
print(card.watchdog_is_expired(), card.watchdog_reload())
card.watchdog_stop()
card.watchdog_clear()
print(f"starved: {speed(card):.0f} rad/s")
card.write_analog(one, 1, np.zeros(1))
card.write_digital(one, 1, np.array([0], dtype=np.int8))
card.close()
