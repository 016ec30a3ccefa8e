"""The numbers of the HIL interface that have names: clocks, modes, states and properties, as the public reference gives them."""

from __future__ import annotations

MAX_STRING_LENGTH = 2**31 - 1
"""The size to give where a text ends by itself."""

ENDLESS = 2**32 - 1
"""The number of samples of a task that runs until it is stopped."""


class Clock:
    """The clock of a task: system clocks are negative, hardware clocks 0 and above."""


for _number in range(1, 5):
    setattr(Clock, f"SYSTEM_CLOCK_{_number}", -_number)
for _number in range(20):
    setattr(Clock, f"HARDWARE_CLOCK_{_number}", _number)


class ClockMode:
    """The use of a hardware clock."""

    TIMEBASE = 0
    PWM = 1
    ENCODER = 2


class AnalogInputConfiguration:
    """The wiring of an analog input."""

    RSE = 0
    NRSE = 1
    DIFF = 2
    PDIFF = 3


class PWMMode:
    """The meaning of a value that is written to a PWM output."""

    DUTY_CYCLE = 0
    FREQUENCY = 1
    PERIOD = 2
    ONE_SHOT = 3
    TIME = 4
    ENCODER_EMULATION = 5
    RAW = 6


class PWMConfiguration:
    """The coupling of PWM outputs."""

    UNIPOLAR = 0
    BIPOLAR = 1
    PAIRED = 2
    COMPLEMENTARY = 3


class PWMAlignment:
    """The place of a pulse in its period."""

    LEADING_EDGE_ALIGNED = 0
    TRAILING_EDGE_ALIGNED = 1
    CENTER_ALIGNED = 2


class PWMPolarity:
    """The level of a pulse: low or high."""

    ACTIVE_LOW = 0
    ACTIVE_HIGH = 1


class DigitalState:
    """The state of a digital output after the watchdog has expired."""

    LOW = 0
    HIGH = 1
    TRISTATE = 2
    NO_CHANGE = 3


class DigitalConfiguration:
    """The driver of a digital output."""

    OPEN_COLLECTOR = 0
    TOTEM_POLE = 1


class EncoderQuadratureMode:
    """The number of counts for each line of an encoder."""

    NONE = 0
    X1 = 1
    X2 = 2
    X4 = 4


class BufferOverflowMode:
    """The behaviour of a task whose buffer is full; the last two are for simulated boards only."""

    ERROR_ON_OVERFLOW = 0
    OVERWRITE_ON_OVERFLOW = 1
    DISCARD_ON_OVERFLOW = 2
    WAIT_ON_OVERFLOW = 3
    SYNCHRONIZED = 4


class IntegerProperty:
    """The whole numbers that a board tells of itself."""

    VENDOR_ID = 0
    PRODUCT_ID = 1
    SUBVENDOR_ID = 2
    SUBPRODUCT_ID = 3
    MAJOR_VERSION = 4
    MINOR_VERSION = 5
    BUILD = 6
    REVISION = 7
    DATE = 8
    TIME = 9
    FIRMWARE_MAJOR_VERSION = 10
    FIRMWARE_MINOR_VERSION = 11
    FIRMWARE_BUILD = 12
    FIRMWARE_REVISION = 13
    FIRMWARE_DATE = 14
    FIRMWARE_TIME = 15
    NUMBER_OF_ANALOG_INPUTS = 16
    NUMBER_OF_ENCODER_INPUTS = 17
    NUMBER_OF_DIGITAL_INPUTS = 18
    NUMBER_OF_OTHER_INPUTS = 19
    NUMBER_OF_ANALOG_OUTPUTS = 20
    NUMBER_OF_PWM_OUTPUTS = 21
    NUMBER_OF_DIGITAL_OUTPUTS = 22
    NUMBER_OF_OTHER_OUTPUTS = 23
    NUMBER_OF_CLOCKS = 24
    NUMBER_OF_INTERRUPTS = 25
    PRODUCT_SPECIFIC = 128


class DoubleProperty:
    """The other numbers that a board tells of itself; all of them belong to single products."""

    PRODUCT_SPECIFIC = 128


class StringProperty:
    """The texts that a board tells of itself."""

    MANUFACTURER = 0
    PRODUCT_NAME = 1
    MODEL_NAME = 2
    SERIAL_NUMBER = 3
    FIRMWARE_VERSION = 4
    PRODUCT_SPECIFIC = 128
