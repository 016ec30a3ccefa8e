"""The errors of the HIL interface: their numbers as published, and what each means in words of our own."""

from __future__ import annotations

from enum import IntEnum


class Code(IntEnum):
    """The numbers of errors, without the sign that the interface gives them."""

    OUT_OF_RANGE = 3
    INVALID_ARGUMENT = 4
    NOT_SUPPORTED = 6
    NO_PERMISSION = 11
    STRING_TOO_SMALL = 17
    INVALID_BUFFER_SIZE = 29
    CANNOT_CONNECT = 33
    CANNOT_RECEIVE = 41
    INVALID_CARD = 88
    FUNCTION_NOT_SUPPORTED = 94
    MISSING_ANALOG_INPUTS = 95
    MISSING_ANALOG_OUTPUTS = 96
    MISSING_ENCODER_INPUTS = 97
    MISSING_PWM_OUTPUTS = 98
    MISSING_DIGITAL_INPUTS = 99
    MISSING_DIGITAL_OUTPUTS = 100
    MISSING_OTHER_INPUTS = 101
    MISSING_OTHER_OUTPUTS = 102
    MISSING_CLOCKS = 103
    TASK_IS_NULL = 104
    INVALID_TASK = 105
    BOARD_NOT_FOUND = 108
    BOARD_IN_USE = 109
    BUFFER_OVERFLOW = 111
    INVALID_ANALOG_INPUT = 121
    INVALID_ENCODER_INPUT = 124
    INVALID_DIGITAL_INPUT = 127
    INVALID_OTHER_INPUT = 130
    INVALID_ANALOG_OUTPUT = 133
    PWM_OUTPUTS_NOT_SUPPORTED = 134
    INVALID_PWM_OUTPUT = 136
    INVALID_DIGITAL_OUTPUT = 139
    INVALID_OTHER_OUTPUT = 142
    CLOCK_NOT_SUPPORTED = 144
    CLOCK_IN_USE = 145
    CLOCK_MODE_NOT_SUPPORTED = 147
    PWM_MODE_NOT_SUPPORTED = 148
    FREQUENCY_NOT_POSITIVE = 149
    FREQUENCY_TOO_HIGH = 150
    TOO_MANY_SAMPLES = 159
    MISSING_ANALOG_INPUT_BUFFER = 160
    MISSING_ENCODER_INPUT_BUFFER = 161
    MISSING_DIGITAL_INPUT_BUFFER = 162
    MISSING_OTHER_INPUT_BUFFER = 163
    MISSING_ANALOG_OUTPUT_BUFFER = 164
    MISSING_PWM_OUTPUT_BUFFER = 165
    MISSING_DIGITAL_OUTPUT_BUFFER = 166
    MISSING_OTHER_OUTPUT_BUFFER = 167
    READING_FROM_WRITER = 168
    WRITING_TO_READER = 169
    UNKNOWN_CARD_TYPE = 179


SENTENCES = {
    Code.OUT_OF_RANGE: "A value lies outside of its range.",
    Code.INVALID_ARGUMENT: "An argument is invalid.",
    Code.NOT_SUPPORTED: "The operation or option isn't supported.",
    Code.NO_PERMISSION: "The board doesn't permit this now.",
    Code.STRING_TOO_SMALL: "The text doesn't fit into the buffer.",
    Code.INVALID_BUFFER_SIZE: "The size of the buffer is invalid.",
    Code.CANNOT_CONNECT: "Nothing could be connected at that address.",
    Code.CANNOT_RECEIVE: "The board no longer answers.",
    Code.INVALID_CARD: "The board isn't open.",
    Code.FUNCTION_NOT_SUPPORTED: "The board doesn't have this function.",
    Code.MISSING_CLOCKS: "The clocks are missing or don't fit.",
    Code.TASK_IS_NULL: "No task was given.",
    Code.INVALID_TASK: "The task is none, or was deleted.",
    Code.BOARD_NOT_FOUND: "There is no board of that type with that identifier.",
    Code.BOARD_IN_USE: "The board is open already.",
    Code.BUFFER_OVERFLOW: "The buffer of the task overflowed, or ran out of samples to write.",
    Code.CLOCK_NOT_SUPPORTED: "The board doesn't have that clock.",
    Code.CLOCK_IN_USE: "The hardware clock is used by another task.",
    Code.CLOCK_MODE_NOT_SUPPORTED: "The clock can't be put into that mode.",
    Code.PWM_OUTPUTS_NOT_SUPPORTED: "The board has no PWM outputs, or they aren't turned on.",
    Code.PWM_MODE_NOT_SUPPORTED: "The PWM output can't be put into that mode.",
    Code.FREQUENCY_NOT_POSITIVE: "The frequency isn't positive.",
    Code.FREQUENCY_TOO_HIGH: "The frequency is too high for the clock.",
    Code.TOO_MANY_SAMPLES: "More samples were requested than the task's buffer holds.",
    Code.READING_FROM_WRITER: "The task writes; nothing can be read from it.",
    Code.WRITING_TO_READER: "The task reads; nothing can be written to it.",
    Code.UNKNOWN_CARD_TYPE: "There is no board of that type.",
}
"""The meaning of each error; `sentence` writes those of channels and their buffers."""


def sentence(code: int) -> str:
    """Return what an error of that number, with or without its sign, means."""
    if abs(code) not in [known.value for known in Code]:
        return f"Error number {abs(code)}, which the stand-in doesn't know."
    member = Code(abs(code))
    if member in SENTENCES:
        return SENTENCES[member]
    words = member.name.lower().split("_")
    if words[-1] == "buffer":
        return f"The buffer for the {words[1]} {words[2]}s is missing or doesn't fit."
    if words[0] == "missing":
        return f"The channels of {words[1]} {words[2]} are missing or don't fit."
    return f"One of the {words[1]} {words[2]} channels doesn't exist on this board."


class GenericError(Exception):
    """An error with a number; `error_code` is negative, as the interface returns it."""

    def __init__(self, error_code: int, detail: str = "") -> None:
        super().__init__(error_code)
        self.error_code = int(error_code)
        self._detail = detail

    def get_error_message(self, locale: str | None = None, buffer_size: int = -1) -> str:
        """Return what the error means, and which value it was; `locale` and `buffer_size` make no difference."""
        return f"{sentence(self.error_code)} {self._detail}".rstrip()

    def __str__(self) -> str:
        return f"{self.error_code}: {self.get_error_message()}"


class HILError(GenericError):
    """An error of a board."""


def hil_error(code: Code, detail: str = "") -> HILError:
    """Return the error of that number; `detail` says which value it was."""
    return HILError(-int(code), detail)
