"""A virtual board is as strict as the real one is, or stricter where that would misread memory in silence."""

import math
from array import array
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from servobench.compat.quanser import install
from servobench.compat.quanser.errors import Code, GenericError, HILError
from servobench.compat.quanser.hil import HIL
from servobench.compat.quanser.session import Bench

ONE, BOTH = np.zeros(1, np.uint32), np.array([0, 1], np.uint32)
LEDS, TACHOMETER = np.array([11000, 11001, 11002], np.uint32), np.array([14000], np.uint32)


@pytest.fixture
def bench() -> Iterator[Bench]:
    with install(quiet=True) as bench:
        yield bench


@pytest.fixture
def card(bench: Bench) -> HIL:
    return HIL("qube_servo2_usb", "0")


def drive(card: HIL, voltage: float) -> None:
    card.write_digital(ONE, 1, np.ones(1, np.int8))
    card.write_analog(ONE, 1, np.array([voltage]))


def wait(bench: Bench, duration: float) -> None:
    bench.timebase.wait_until(bench.timebase.now() + duration)


def counts(card: HIL) -> int:
    found = np.zeros(1, np.int32)
    card.read_encoder(ONE, 1, found)
    return int(found[0])


def fails(code: Code) -> Any:
    """An error of that number."""
    return pytest.raises(HILError, check=lambda error: error.error_code == -code)


# --- opening and closing ---


def test_only_boards_that_exist_open(bench: Bench) -> None:
    with fails(Code.UNKNOWN_CARD_TYPE):
        HIL("qube_servo9_usb", "0")
    with fails(Code.BOARD_NOT_FOUND):
        HIL("qube_servo2_usb", "1")
    with fails(Code.CANNOT_CONNECT):
        HIL("qube_servo2_usb", "0@tcpip://localhost:18922?nagle='off'")


@pytest.mark.parametrize(
    ("card_type", "port"),
    [
        ("qube_servo2_usb", 18920),
        ("qube_servo2_usb", 18921),
        ("qube_servo3_usb", 18922),
        ("qube_servo3_usb", 18923),
    ],
)
def test_boards_of_the_simulator_open_by_their_addresses(bench: Bench, card_type: str, port: int) -> None:
    card = HIL(card_type, f"0@tcpip://localhost:{port}?nagle='off'")

    assert card.is_valid()


def test_a_board_opens_once_at_a_time(bench: Bench, card: HIL) -> None:
    with fails(Code.BOARD_IN_USE):
        HIL("qube_servo2_usb", "0")
    card.close()

    assert HIL("qube_servo2_usb", "0").is_valid()


def test_a_board_that_is_closed_refuses_everything_but_closing(card: HIL) -> None:
    task = card.task_create_encoder_reader(10, ONE, 1)
    card.close()
    card.close()

    assert not card.is_valid()
    for call in (
        lambda: card.read_encoder(ONE, 1, np.zeros(1, np.int32)),
        lambda: card.write_analog(ONE, 1, np.zeros(1)),
        lambda: card.task_stop_all(),
        lambda: card.watchdog_start(0.1),
        lambda: card.get_string_property(3, 64),
    ):
        with fails(Code.INVALID_CARD):
            call()
    with fails(Code.INVALID_TASK):
        card.task_read_encoder(task, 1, np.zeros(1, np.int32))


def test_an_error_has_a_number_and_words_and_is_a_generic_error(bench: Bench) -> None:
    with pytest.raises(GenericError) as caught:
        HIL("q9", "0")

    assert isinstance(caught.value, HILError)
    assert "no board of that type" in caught.value.get_error_message()
    assert "q9" in caught.value.get_error_message(None, 100)


# --- arrays ---


@pytest.mark.parametrize(
    "channels", [array("i", [0]), array("I", [0]), ONE, np.zeros(1, np.int32), np.zeros(1, np.int64)]
)
def test_channels_come_in_every_form_that_programs_use(card: HIL, channels: Any) -> None:
    found = array("i", [7])
    card.read_encoder(channels, 1, found)

    assert list(found) == [0]


@pytest.mark.parametrize(
    "buffer", [array("l", [7, 7]), np.full(2, 7, np.int64), np.full((2, 1), 7, np.int32)]
)
def test_counts_go_into_integers_of_a_long_too(card: HIL, buffer: Any) -> None:
    card.set_encoder_counts(BOTH, 2, array("l", [-5, 3]))
    card.read_encoder(BOTH, 2, buffer)

    assert np.asarray(buffer).reshape(-1).tolist() == [-5, 3]


def test_what_is_read_right_by_luck_passes_and_what_is_misread_does_not(card: HIL) -> None:
    card.write_digital(ONE, 1, np.array([1], np.int32))  # its lowest byte comes first
    with fails(Code.MISSING_DIGITAL_OUTPUT_BUFFER):
        card.write_digital(ONE, 1, np.array([256], np.int32))
    with fails(Code.MISSING_ANALOG_OUTPUT_BUFFER):
        card.write_analog(ONE, 1, np.array([1, 0], np.int64))
    with fails(Code.MISSING_ANALOG_OUTPUT_BUFFER):
        card.write_analog(ONE, 1, np.array([1.0, 0.0], np.float32))


@pytest.mark.parametrize("kind", [np.float32, np.float64, np.int8, np.int16])
def test_a_buffer_of_a_wrong_type_is_refused_before_anything_is_written_into_it(card: HIL, kind: Any) -> None:
    buffer = np.full(1, 7, kind)
    with fails(Code.MISSING_ENCODER_INPUT_BUFFER):
        card.read_encoder(ONE, 1, buffer)

    assert buffer[0] == 7


@pytest.mark.parametrize("buffer", [bytearray(b"\xff" * 4), np.full(5, 255, np.uint8), array("b", [-1] * 4)])
def test_bytes_are_memory_and_filled_whole(card: HIL, buffer: Any) -> None:
    import struct

    card.set_encoder_counts(struct.pack("I", 0), 1, struct.pack("i", -70000))
    card.read_encoder(ONE, 1, buffer)

    assert struct.unpack("i", bytes(memoryview(buffer).cast("B"))[:4]) == (-70000,)


def test_voltages_may_be_packed_bytes(bench: Bench, card: HIL) -> None:
    import struct

    card.write_analog(ONE, 1, struct.pack("d", 1.5))

    assert bench.board.motion.voltage == 1.5


def test_numbers_of_another_byte_order_are_refused(card: HIL) -> None:
    with fails(Code.MISSING_ANALOG_OUTPUT_BUFFER):
        card.write_analog(ONE, 1, np.array([0.5], ">f8"))


def test_the_sentence_of_a_buffer_that_does_not_fit_does_not_call_it_missing_alone(card: HIL) -> None:
    with pytest.raises(HILError, match=r"missing or doesn't fit\. encoder buffer: the array is read-only"):
        card.read_encoder(ONE, 1, np.frombuffer(bytes(4), np.int32))


def test_arrays_that_are_too_short_are_refused(card: HIL) -> None:
    with fails(Code.MISSING_ENCODER_INPUT_BUFFER):
        card.read_encoder(BOTH, 2, np.zeros(1, np.int32))
    with fails(Code.MISSING_ENCODER_INPUTS):
        card.read_encoder(ONE, 2, np.zeros(2, np.int32))
    with fails(Code.MISSING_OTHER_OUTPUT_BUFFER):
        card.write_other(LEDS, 3, np.zeros(2))
    task = card.task_create_encoder_reader(10, ONE, 1)
    with fails(Code.MISSING_ENCODER_INPUT_BUFFER):
        card.task_read_encoder(task, 5, np.zeros(4, np.int32))


def test_a_negative_number_of_channels_is_an_error_and_not_none(card: HIL) -> None:
    with pytest.raises(OverflowError, match="number of encoder channels is -1"):
        card.read_encoder(ONE, -1, np.zeros(1, np.int32))


def test_a_list_is_no_array(card: HIL) -> None:
    with pytest.raises(TypeError, match="array"):
        card.read_encoder([0], 1, np.zeros(1, np.int32))


def test_groups_that_are_none_are_left_out_and_channels_without_an_array_are_missing(card: HIL) -> None:
    found = np.full(1, 7, np.int32)
    card.read(None, 0, ONE, 1, None, 0, None, 0, None, found, None, None)

    assert found[0] == 0
    with fails(Code.MISSING_ENCODER_INPUTS):
        card.read(None, 0, None, 1, None, 0, None, 0, None, found, None, None)
    with fails(Code.MISSING_ENCODER_INPUT_BUFFER):
        card.read(None, 0, ONE, 1, None, 0, None, 0, None, None, None, None)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_what_is_no_number_never_reaches_the_motor(bench: Bench, card: HIL, value: float) -> None:
    drive(card, 1.0)
    with fails(Code.OUT_OF_RANGE):
        card.write_analog(ONE, 1, np.array([value]))

    assert bench.board.motion.voltage == 1.0


@pytest.mark.parametrize(
    ("act", "code"),
    [
        (lambda card: card.read_analog(np.ones(1, np.uint32), 1, np.zeros(1)), Code.INVALID_ANALOG_INPUT),
        (lambda card: card.read_other(np.zeros(1, np.uint32), 1, np.zeros(1)), Code.INVALID_OTHER_INPUT),
        (lambda card: card.write_digital(np.ones(1, np.uint32), 1, np.zeros(1, np.int8)), Code.INVALID_DIGITAL_OUTPUT),
        (lambda card: card.write_pwm(ONE, 1, np.zeros(1)), Code.PWM_OUTPUTS_NOT_SUPPORTED),
        (lambda card: card.task_start(card.task_create_encoder_reader(9, ONE, 1), 3, 100, 1), Code.CLOCK_NOT_SUPPORTED),
        (lambda card: card.task_start(card.task_create_encoder_reader(9, ONE, 1), 0, 0, 1), Code.FREQUENCY_NOT_POSITIVE),
        (lambda card: card.task_start(None, 0, 100, 1), Code.TASK_IS_NULL),
        (lambda card: card.task_start(object(), 0, 100, 1), Code.INVALID_TASK),
        (lambda card: card.task_create_encoder_reader(0, ONE, 1), Code.INVALID_BUFFER_SIZE),
        (lambda card: card.set_encoder_quadrature_mode(ONE, 1, np.array([3], np.int32)), Code.INVALID_ARGUMENT),
        (lambda card: card.set_encoder_counts(ONE, 1, np.array([2**23], np.int32)), Code.OUT_OF_RANGE),
        (lambda card: card.set_card_specific_options("colour=1", 64), Code.INVALID_ARGUMENT),
        (lambda card: card.watchdog_start(0.0), Code.OUT_OF_RANGE),
    ],
)  # fmt: skip
def test_what_a_board_cannot_do_is_an_error_with_its_number(card: HIL, act: Any, code: Code) -> None:
    with fails(code):
        act(card)


# --- motor and sensors ---


def test_the_motor_turns_only_while_the_amplifier_is_on(bench: Bench, card: HIL) -> None:
    card.write_analog(ONE, 1, np.array([5.0]))
    wait(bench, 1.0)
    assert counts(card) == 0
    card.write_digital(ONE, 1, np.ones(1, np.int8))
    wait(bench, 1.0)
    assert counts(card) > 10_000
    card.write_digital(ONE, 1, np.zeros(1, np.int8))
    wait(bench, 3.0)
    before = counts(card)
    wait(bench, 1.0)

    assert counts(card) == before


def test_current_tachometer_and_light_are_where_they_should_be(bench: Bench, card: HIL) -> None:
    drive(card, 5.0)
    card.write_other(LEDS, 3, np.array([0.25, 1.5, 0.0]))
    wait(bench, 2.0)
    speed, current, codes = np.zeros(1), np.zeros(1), np.zeros(1, np.int32)
    card.read_other(TACHOMETER, 1, speed)
    card.read_analog(ONE, 1, current)
    card.read_analog_codes(ONE, 1, codes)

    # (V - T_c R / k) k / (R b + k²) with the twin's values: 4.84 V x 23.70 rad/(s·V).
    assert abs(speed[0] * 2 * math.pi / 2048 - 114.7) < 0.1
    # T_c / k + b ω / k = 21.8 mA, in steps of 6 A / 4096.
    assert abs(current[0] - 0.0218) <= 6 / 4096
    assert current[0] == codes[0] * 6 / 4096
    assert bench.board.lights == (0.25, 1.0, 0.0)


def test_a_counter_wraps_at_24_bits_either_way(bench: Bench, card: HIL) -> None:
    for sign in (1, -1):
        card.set_encoder_counts(ONE, 1, np.array([sign * (2**23 - 100)], np.int32))
        drive(card, sign * 5.0)
        wait(bench, 1.0)
        card.write_analog(ONE, 1, np.zeros(1))
        wait(bench, 2.0)

        assert -sign * counts(card) > 2**22


@pytest.mark.parametrize(("mode", "part"), [(0, 4), (1, 4), (2, 2), (4, 1)])
def test_the_quadrature_mode_says_how_many_edges_count(bench: Bench, card: HIL, mode: int, part: int) -> None:
    card.set_encoder_quadrature_mode(BOTH, 2, np.full(2, mode, np.int32))
    drive(card, 3.0)
    wait(bench, 1.0)

    assert abs(counts(card) - bench.board.motion.plant.state.angle * 2048 / (2 * math.pi) / part) <= 1.0


def test_a_stall_is_warned_of_and_cut_off_after_three_seconds_until_the_amplifier_is_turned_off(
    bench: Bench, card: HIL
) -> None:
    lines, faults = np.array([0, 1, 2], np.uint32), np.zeros(3, np.int8)
    drive(card, 6.0)
    bench.board.motion.plant.blocked = True
    states = []
    for duration in (0.5, 2.0, 1.0):
        wait(bench, duration)
        card.read_digital(lines, 3, faults)
        states.append(faults.tolist())

    assert states == [[0, 1, 0], [0, 1, 0], [0, 0, 1]]
    assert not bench.board.motion.drives
    card.write_digital(ONE, 1, np.zeros(1, np.int8))
    card.read_digital(lines, 3, faults)
    assert faults.tolist() == [0, 0, 0]


def test_five_volts_on_a_blocked_shaft_are_no_stall(bench: Bench, card: HIL) -> None:
    drive(card, 5.0)
    bench.board.motion.plant.blocked = True
    wait(bench, 10.0)

    assert bench.board.motion.drives


def test_a_qube_servo_3_is_driven_by_voltage_or_by_pwm(bench: Bench) -> None:
    card = HIL("qube_servo3_usb", "0")
    card.set_card_specific_options("deadband_compensation=0.3;pwm_en=1;enc0_velocity=3.0", 2**31 - 1)
    card.write_digital(ONE, 1, np.ones(1, np.int8))
    card.set_pwm_frequency(ONE, 1, np.array([20000.0]))
    card.write_pwm(ONE, 1, np.array([-0.2]))
    wait(bench, 1.0)

    assert counts(card) < -1000
    with fails(Code.INVALID_ANALOG_OUTPUT):
        card.write_analog(ONE, 1, np.zeros(1))


# --- tasks ---


def test_a_task_gives_a_sample_each_tick_and_ends_with_the_last(bench: Bench, card: HIL) -> None:
    task = card.task_create_encoder_reader(50, ONE, 1)
    card.task_start(task, 0, 100.0, 25)
    began, found, buffer = bench.timebase.now(), [], np.zeros(10, np.int32)
    for _ in range(4):
        found.append((card.task_read_encoder(task, 10, buffer), round(bench.timebase.now() - began, 9)))

    assert found == [(10, 0.1), (10, 0.2), (5, 0.25), (0, 0.25)]


@pytest.mark.parametrize(("mode", "first"), [(1, 90), (2, 0)])
def test_a_buffer_that_overflows_keeps_the_new_or_the_old_samples_and_counts(
    bench: Bench, card: HIL, mode: int, first: int
) -> None:
    drive(card, 3.0)
    wait(bench, 1.0)
    task = card.task_create_encoder_reader(10, ONE, 1)
    card.task_set_buffer_overflow_mode(task, mode)
    card.task_start(task, 0, 1000.0, HIL.INFINITE)
    at_start, buffer = counts(card), np.zeros(1, np.int32)
    wait(bench, 0.1003)  # between two ticks
    card.task_read_encoder(task, 1, buffer)

    assert card.task_get_buffer_overflows(task) == 90
    # 67 rad/s are 21.9 counts a tick; the first sample is a tick away from the start.
    assert abs((buffer[0] - at_start) / 21.9 - (first + 1)) < 0.5


def test_a_buffer_that_overflows_is_an_error_by_default_and_the_task_can_be_started_again(
    bench: Bench, card: HIL
) -> None:
    task, buffer = card.task_create_encoder_reader(10, ONE, 1), np.zeros(1, np.int32)
    card.task_start(task, 0, 1000.0, HIL.INFINITE)
    wait(bench, 0.1)
    with fails(Code.BUFFER_OVERFLOW):
        card.task_read_encoder(task, 1, buffer)
    card.task_start(task, 0, 1000.0, HIL.INFINITE)

    assert card.task_read_encoder(task, 1, buffer) == 1


def test_a_board_of_the_simulator_waits_for_its_reader(bench: Bench) -> None:
    card, buffer = HIL("qube_servo2_usb", "0@tcpip://localhost:18920"), np.zeros(1, np.int32)
    task = card.task_create_encoder_reader(5, ONE, 1)
    card.task_set_buffer_overflow_mode(task, 4)
    card.task_start(task, 0, 1000.0, HIL.INFINITE)
    wait(bench, 1.0)

    assert [card.task_read_encoder(task, 1, buffer) for _ in range(100)] == [1] * 100
    assert card.task_get_buffer_overflows(task) == 0


def test_only_boards_of_the_simulator_wait(card: HIL) -> None:
    task = card.task_create_encoder_reader(5, ONE, 1)
    with fails(Code.NOT_SUPPORTED):
        card.task_set_buffer_overflow_mode(task, 4)


def test_a_writer_puts_its_samples_out_one_a_tick_and_waits_for_room(bench: Bench, card: HIL) -> None:
    card.write_digital(ONE, 1, np.ones(1, np.int8))
    task = card.task_create_analog_writer(100, ONE, 1)
    card.task_start(task, 0, 100.0, HIL.INFINITE)
    began = bench.timebase.now()
    assert card.task_write_analog(task, 100, np.linspace(0.0, 1.0, 100)) == 100
    assert bench.timebase.now() == began
    assert card.task_write_analog(task, 50, np.full(50, 2.0)) == 50
    assert round(bench.timebase.now() - began, 6) == 0.5
    card.task_flush(task)

    assert round(bench.timebase.now() - began, 6) == 1.5
    assert bench.board.motion.voltage == 2.0


def test_a_writer_that_runs_dry_is_an_error_by_default(bench: Bench, card: HIL) -> None:
    task = card.task_create_analog_writer(10, ONE, 1)
    card.task_start(task, 0, 100.0, HIL.INFINITE)
    card.task_write_analog(task, 1, np.zeros(1))
    wait(bench, 1.0)

    with fails(Code.BUFFER_OVERFLOW):
        card.task_write_analog(task, 1, np.zeros(1))


def test_a_task_that_reads_and_writes_does_both_at_each_tick(bench: Bench, card: HIL) -> None:
    card.write_digital(ONE, 1, np.ones(1, np.int8))
    none = (None, 0)
    task = card.task_create_reader_writer(100, *none, ONE, 1, *none, *none, ONE, 1, *none, *none, *none)
    card.task_start(task, 0, 500.0, HIL.INFINITE)
    buffer = np.zeros(1, np.int32)
    for _ in range(500):
        card.task_read_write(task, 1, None, buffer, None, None, np.full(1, 2.0), None, None, None)

    assert buffer[0] > 10_000
    card.task_stop(task)
    card.task_delete(task)
    with fails(Code.INVALID_TASK):
        card.task_stop(task)


def test_reading_a_writer_and_writing_a_reader_are_errors(card: HIL) -> None:
    with fails(Code.READING_FROM_WRITER):
        card.task_read_analog(card.task_create_analog_writer(9, ONE, 1), 1, np.zeros(1))
    with fails(Code.WRITING_TO_READER):
        card.task_write_analog(card.task_create_analog_reader(9, ONE, 1), 1, np.zeros(1))
    with fails(Code.TOO_MANY_SAMPLES):
        card.task_read_analog(card.task_create_analog_reader(9, ONE, 1), 10, np.zeros(10))


# --- watchdog and properties ---


def test_a_watchdog_that_expires_lights_blue_and_takes_the_motor_away(bench: Bench, card: HIL) -> None:
    drive(card, 5.0)
    card.watchdog_start(0.2)
    wait(bench, 0.1)
    assert card.watchdog_reload()
    wait(bench, 0.3)

    assert card.watchdog_is_expired()
    assert bench.board.lights == (0.0, 0.0, 1.0)
    assert (bench.board.motion.voltage, bench.board.motion.drives) == (0.0, False)
    assert not card.watchdog_reload()
    with fails(Code.NO_PERMISSION):
        card.write_analog(ONE, 1, np.zeros(1))
    card.watchdog_clear()
    card.write_analog(ONE, 1, np.ones(1))
    assert bench.board.motion.drives


def test_a_board_may_have_no_watchdog() -> None:
    with install(quiet=True, has_watchdog=False):
        card = HIL("qube_servo2_usb", "0")
        with fails(Code.FUNCTION_NOT_SUPPORTED):
            card.watchdog_start(0.1)


def test_a_text_property_comes_in_two_forms(card: HIL) -> None:
    letters: list[str] = []
    assert card.get_string_property(3, letters, 64) is None
    memory = array("b", [0] * 64)
    card.get_string_property(3, memory, 64)

    assert card.get_string_property(3, 64) == "".join(letters) == "simulated"
    assert memory.tobytes().startswith(b"simulated\0")
    with fails(Code.STRING_TOO_SMALL):
        card.get_string_property(3, 5)


def test_the_number_of_channels_is_a_property(card: HIL) -> None:
    asked, found = np.array([16, 17, 18, 22], np.int32), np.zeros(4, np.int32)
    card.get_integer_property(asked, 4, found)

    assert found.tolist() == [1, 2, 3, 1]


# --- unplugging and ending ---


def test_a_board_that_is_unplugged_answers_nothing_more_and_its_motor_coasts(bench: Bench, card: HIL) -> None:
    drive(card, 5.0)
    task = card.task_create_encoder_reader(1000, ONE, 1)
    card.task_start(task, 0, 500.0, HIL.INFINITE)
    wait(bench, 1.0)
    bench.unplug()

    buffer = np.full(1, 7, np.int32)
    for call in (
        lambda: card.read_encoder(ONE, 1, buffer),
        lambda: card.task_read_encoder(task, 1, buffer),
        lambda: card.write_analog(ONE, 1, np.zeros(1)),
    ):
        with fails(Code.CANNOT_RECEIVE):
            call()
    assert buffer[0] == 7
    assert not bench.board.motion.drives
    card.close()


def test_what_was_replaced_is_back_after_the_end() -> None:
    import sys
    import time

    functions = (time.time, time.sleep, time.perf_counter, time.monotonic_ns)
    with install(quiet=True):
        assert "quanser.hardware" in sys.modules
        assert time.time is not functions[0]

    assert (time.time, time.sleep, time.perf_counter, time.monotonic_ns) == functions
    assert "quanser.hardware" not in sys.modules


def test_two_stand_ins_at_a_time_are_refused(bench: Bench) -> None:
    with pytest.raises(RuntimeError, match="installed already"):
        install()


def test_the_modules_that_programs_import_are_there_and_say_what_they_lack(bench: Bench) -> None:
    import importlib

    for name in ("quanser.common", "quanser.communications", "quanser.devices", "quanser.multimedia"):
        importlib.import_module(name)
    from quanser.common import GenericError as Generic
    from quanser.common import Timeout
    from quanser.communications import PollFlag, Stream
    from quanser.devices.exceptions import DeviceError
    from quanser.hardware import HIL as HARDWARE
    from quanser.hardware import Clock, DigitalState, EncoderQuadratureMode, HILError, StringProperty

    assert HARDWARE is HIL
    assert issubclass(HILError, Generic)
    assert issubclass(DeviceError, Generic)
    assert (Clock.HARDWARE_CLOCK_0, Clock.SYSTEM_CLOCK_1, EncoderQuadratureMode.X4) == (0, -1, 4)
    assert (DigitalState.TRISTATE, StringProperty.SERIAL_NUMBER, HARDWARE.INFINITE) == (2, 3, 2**32 - 1)
    assert Timeout(seconds=0, nanoseconds=1).nanoseconds == 1
    assert PollFlag.RECEIVE is not None
    with pytest.raises(Generic, match="need Quanser's own software"):
        Stream()


# --- waits ---


def test_the_motor_turns_while_the_program_sleeps(bench: Bench, card: HIL) -> None:
    import time

    drive(card, 2.0)
    before = bench.board.motion.angles[0]
    time.sleep(2.0)

    # K (V - V_c) (t - tau), as in the programs; the call after a sleep has nothing to catch up with.
    assert bench.board.motion.angles[0] - before == pytest.approx((2 - 0.16) / 0.042 * 1.9, rel=0.01)


def test_a_sleep_that_is_interrupted_has_lasted_as_long_as_the_motor_turned(
    bench: Bench, card: HIL, monkeypatch: pytest.MonkeyPatch
) -> None:
    import time

    drive(card, 2.0)
    motion = bench.board.motion
    advance = motion.advance_to

    def interrupt(moment: float) -> None:
        if moment > 5.0:
            raise KeyboardInterrupt
        advance(moment)

    with monkeypatch.context() as patch:
        patch.setattr(motion, "advance_to", interrupt)
        with pytest.raises(KeyboardInterrupt):
            time.sleep(1e6)

    assert 5.0 < bench.timebase.now() < 7.0


@pytest.fixture
def wall(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """A wall clock and the processor's, which go as the test says [s]."""
    from servobench.compat.quanser import timebase, waits

    clocks = [0.0, 0.0]
    monkeypatch.setattr(timebase, "_wall", lambda: clocks[0])
    monkeypatch.setattr(waits, "_cpu", lambda: clocks[1])
    return clocks


@pytest.mark.parametrize(("answer", "lasts"), [(3.05, 3.0), (0.01, 0.0)])
def test_input_takes_the_time_that_somebody_takes_to_answer(
    wall: list[float], monkeypatch: pytest.MonkeyPatch, answer: float, lasts: float
) -> None:
    import builtins

    def slow(prompt: str) -> str:
        wall[0] += answer
        return prompt

    monkeypatch.setattr(builtins, "input", slow)
    with install(quiet=True) as bench:
        assert input("Enter") == "Enter"
        assert bench.timebase.now() == pytest.approx(lasts)
    assert builtins.input is slow


@pytest.mark.parametrize(
    ("voltage", "computed", "lines"),
    [(2.0, 0.0, 1), (2.0, 1.0, 0), (0.0, 0.0, 0)],
    ids=["waits", "computes", "rests"],
)
def test_a_wait_that_nothing_simulates_is_reported_once(
    wall: list[float], capsys: pytest.CaptureFixture[str], voltage: float, computed: float, lines: int
) -> None:
    with install():
        card = HIL("qube_servo2_usb", "0")
        drive(card, voltage)
        for _ in range(100):
            wall[0] += 0.05
            wall[1] += 0.05 * computed
            counts(card)
        card.close()

    assert capsys.readouterr().err.count("simulated time stood still") == lines
