"""Balances a pendulum that somebody lifts: state feedback within ten degrees of upright, nothing elsewhere."""

import math

import numpy as np
from quanser.hardware import HIL, Clock

both, one = np.array([0, 1], dtype=np.uint32), np.array([0], dtype=np.uint32)
counts, gains = np.zeros(2, dtype=np.int32), np.array([2.0, 35.0, 1.5, 3.0])
frequency, cutoff = 500.0, 100.0

card = HIL("qube_servo3_usb", "0")
card.set_encoder_counts(both, 2, counts)
card.write_digital(one, 1, np.array([1], dtype=np.int8))
task = card.task_create_encoder_reader(int(frequency), both, 2)
card.task_start(task, Clock.HARDWARE_CLOCK_0, frequency, HIL.INFINITE)
rates, before, balanced = np.zeros(2), np.zeros(2), 0
for _ in range(int(12 * frequency)):
    card.task_read_encoder(task, 1, counts)
    angles = counts * 2 * math.pi / 2048
    angles[1] = angles[1] % (2 * math.pi) - math.pi
    rates = (rates + cutoff * (angles - before)) / (1 + cutoff / frequency)
    before = angles
    upright = abs(angles[1]) < math.radians(10)
    balanced = balanced + 1 if upright else 0
    voltage = float(gains @ np.concatenate([angles, rates])) if upright else 0.0
    card.write_analog(one, 1, np.array([np.clip(voltage, -10, 10)]))
print(f"balanced for {balanced / frequency:.1f} s, the arm at {angles[0]:.1f} rad")
card.write_analog(one, 1, np.zeros(1))
card.write_digital(one, 1, np.array([0], dtype=np.int8))
card.task_stop(task)
card.task_delete(task)
card.close()
