"""A PD loop at 1 kHz whose speed is a filtered derivative, with current, tachometer and light, until Ctrl-C or 3 s."""

import math
import signal
import sys
from array import array

from quanser.hardware import HIL, MAX_STRING_LENGTH, Clock, HILError

stop = False


def end(number, frame):
    global stop
    stop = True


signal.signal(signal.SIGINT, end)
period, cutoff = 0.001, 100.0
card = HIL("qube_servo3_usb", "0")
card.set_card_specific_options("deadband_compensation=0.65;pwm_en=0", MAX_STRING_LENGTH)
zero, leds = array("I", [0]), array("i", [11000, 11001, 11002])
current, counts, faults, speed = array("d", [0]), array("i", [0]), array("b", [0] * 3), array("d", [0])
try:
    card.set_encoder_counts(zero, 1, counts)
    card.write_other(leds, 3, array("d", [0, 1, 0]))
    card.write_digital(zero, 1, array("b", [1]))
    task = card.task_create_reader(1000, zero, 1, zero, 1, array("I", [0, 1, 2]), 3, array("I", [14000]), 1)
    card.task_start(task, Clock.HARDWARE_CLOCK_0, 1 / period, HIL.INFINITE)
    filtered = before = worst = 0.0
    for k in range(3000):
        card.task_read(task, 1, current, counts, faults, speed)
        if stop or any(faults):
            break
        angle = counts[0] * math.pi / 1024
        filtered = (filtered + cutoff * (angle - before)) / (1 + cutoff * period)
        before = angle
        worst = max(worst, abs(filtered - speed[0] * math.pi / 1024))
        goal = 0.5 if (k * period * 0.8) % 2 < 1 else -0.5
        card.write_analog(zero, 1, array("d", [max(-10, min(10, 8.0 * (goal - angle) - 0.16 * filtered))]))
    print(f"angle {angle:.2f} rad, derivative and tachometer differ by {worst:.1f} rad/s at most")
    card.task_stop(task)
    card.task_delete(task)
except HILError as error:
    print("Unable to control.", error.get_error_message())
finally:
    card.write_analog(zero, 1, array("d", [0]))
    card.write_digital(zero, 1, array("b", [0]))
    card.write_other(leds, 3, array("d", [1, 0, 0]))
    card.close()
sys.exit(0)
