"""A task at the hardware clock that is the time base of a proportional position loop, until it was read 2000 times."""

import numpy as np
from quanser.hardware import HIL, Clock, HILError
from quanser.hardware.enumerations import BufferOverflowMode

one = np.array([0], dtype=np.uint32)
counts = np.zeros(1, dtype=np.int32)
reference = np.pi

card = HIL("qube_servo2_usb", "0")
try:
    card.write_analog(one, 1, np.zeros(1, dtype=np.float64))
    card.set_encoder_counts(one, 1, counts)
    card.write_digital(one, 1, np.array([1], dtype=np.int8))
    task = card.task_create_reader(100, None, 0, one, 1, None, 0, None, 0)
    card.task_set_buffer_overflow_mode(task, BufferOverflowMode.ERROR_ON_OVERFLOW)
    card.task_start(task, Clock.HARDWARE_CLOCK_0, 1000.0, 2**32 - 1)
    for _ in range(2000):
        card.task_read(task, 1, None, counts, None, None)
        position = counts[0] * 2 * np.pi / 2048
        card.write_analog(one, 1, np.array([np.clip(3.0 * (reference - position), -10, 10)]))
    print(f"position {position:.2f} rad, {card.task_get_buffer_overflows(task)} overflows")
    card.task_stop(task)
    card.task_delete(task)
    card.write_analog(one, 1, np.zeros(1))
    card.write_digital(one, 1, np.array([0], dtype=np.int32))  # a type that is read right by luck
except HILError as error:
    print("Unable to run the task.", error.get_error_message())
finally:
    card.close()
