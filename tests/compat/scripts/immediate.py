"""Immediate input and output, timed by sleeping: a constant voltage, and the encoder read now and then."""

import time
from array import array

from quanser.hardware import HIL, HILError

motor, encoder, enable = array("i", [0]), array("I", [0, 1]), array("i", [0])
counts, voltage = array("i", [0, 0]), array("d", [2.0])

card = HIL()
card.open("qube_servo2_usb", "0")
try:
    card.set_encoder_counts(encoder, 2, array("l", [0, 0]))
    card.write_digital(enable, 1, array("b", [1]))
    card.write_analog(motor, 1, voltage)
    began = time.time()
    for _ in range(20):
        time.sleep(0.05)
        card.read_encoder(encoder, len(encoder), counts)
    print(f"{counts[0]} counts after {time.time() - began:.3f} s")
    voltage[0] = 0.0
    card.write_analog(motor, 1, voltage)
    card.write_digital(enable, 1, array("b", [0]))
except HILError as error:
    print("Unable to turn the motor.", error.get_error_message())
finally:
    card.close()
