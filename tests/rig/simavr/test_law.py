"""The PI law on the board, in simavr: the same as in floating point, within its limit, and what ends it."""

import math
from typing import Any

import numpy as np
import pytest

from servobench.core.channels import Channel, DeviceInfo, Sample
from servobench.identification.identify import identify
from servobench.recordings.measurement.measure import measure
from servobench.rig.devices.rig import LATCH_TO_LAW
from servobench.rig.experiment import Experiment, Limits
from servobench.rig.experiment.limits import Outputs
from servobench.systems.control.pi import Pi
from servobench.systems.control.pid import Pid
from servobench.systems.signals.square import Square
from servobench.systems.signals.step import Step
from tests.rig.simavr.board import CYCLES, FAULTS, MODES, MS, REFUSALS, STATES, Board, motor
from tests.rig.simavr.build import needed
from tests.rig.simavr.lockstep import Bench

pytestmark = pytest.mark.usefixtures("simavr")
ONE = 2**16  # of kp
SUM = 2**24  # of ki


@pytest.fixture(scope="module")
def simavr() -> None:
    needed()


def follow(
    mode: str, references: list[int], kp: int, ki: int, limit: int, period: int = 1
) -> list[tuple[int, int, int]]:
    """Let the board follow references for 0.2 s each; return position, duty and the reference in force of each sample."""
    with Board() as board:
        board.claim()
        assert board.ask("gains", kp=kp, ki=ki, limit=limit)["refusal"] == 0
        assert board.ask("enable", mode=MODES[mode])["state"] == STATES["operation_enabled"]
        board.send("reference", reference=references[0])
        board.ask("sampling", period=period, block=1)
        found: list[tuple[int, int, int]] = []
        for reference in references:
            # Between two ticks, so that the sample after it is the first with the new reference: the chip's ticks come 0.3 ms
            # after the simulator's milliseconds, as it takes so long to get ready.
            board.run(cycles=(MS // 2 - board.look().cycle) % MS)
            board.send("reference", reference=reference)
            board.run(ms=0.4)
            changed = board.look().cycle // MS
            for _ in range(10):
                board.run(ms=20)
                board.send("reference", reference=reference)
            for block in board.taken("block"):
                position = block["position"]
                for k in range(8):
                    position += block["delta"][k - 1] if k else 0
                    late = block["time"] + k * period <= changed
                    of = references[max(0, references.index(reference) - 1)] if late else reference
                    found.append((position, block["duty"][k], of))
        assert board.status()["faults"] == 0
        assert board.status()["tx_lost"] == board.sequence_gaps == 0
        return found


def in_float(
    mode: str, seen: list[tuple[int, int, int]], kp: int, ki: int, limit: int, period: int
) -> list[float]:
    """The duties of the same law in floating point, for the same positions: in a volt of duty and a radian of count."""
    law = Pi.model_validate({"output": mode, "kp": kp / ONE, "ki": ki / SUM / (period / 1000)})
    voltage = Channel(name="voltage", unit="V", minimum=-limit, maximum=limit)
    counts = Channel(name="counts", unit="counts", counter_bits=32, counts_per_rev=2 * math.pi)
    state = law.start(period / 1000, DeviceInfo(name="paper", channels=(voltage, counts)))
    duties = []
    for k, (position, _, reference) in enumerate(seen):
        state, wanted = law.step(state, reference, Sample(index=k, time=k * period / 1000, counts=position))
        duties.append(min(max(wanted, -limit), limit))
    return duties


CASES = {
    "position": ("position", [300, -300, 0], 3 * ONE // 2, 0, 1024, 1),
    "position with an integral": ("position", [300, -300, 0], ONE, SUM // 100, 1024, 1),
    "position at its limit": ("position", [3000, -3000, 0], 3 * ONE, SUM // 50, 300, 1),
    "position each 2 ms": ("position", [300, -300, 0], ONE, SUM // 100, 1024, 2),
    "speed": ("speed", [20_000, -20_000, 5_000], ONE // 50, SUM // 2000, 1024, 1),
    "speed at its limit": ("speed", [60_000, -60_000, 5_000], ONE // 20, SUM // 500, 400, 1),
}


@pytest.mark.parametrize("case", CASES)
def test_the_law_on_the_board_is_that_in_floating_point(case: str) -> None:
    mode, references, kp, ki, limit, period = CASES[case]
    seen = follow(mode, references, kp, ki, limit, period)

    expected = in_float(mode, seen, kp, ki, limit, period)

    assert len(seen) > 500 / period
    # Both have the gains, whole numbers of the board, exactly: what is left is that the board rounds down to a duty, by
    # less than 1, and the rounding of floats.
    error = np.array(expected) - [duty for _, duty, _ in seen]
    assert error.min() > -1e-6
    assert error.max() < 1 + 1e-6
    assert max(abs(duty) for _, duty, _ in seen) <= limit
    assert (max(abs(duty) for _, duty, _ in seen) == limit) == ("limit" in case)


def test_the_integral_does_not_wind_up_at_the_limit() -> None:
    """A sum that went on while the duty was at its limit would take as long to come back: the shaft would run past by far."""
    seen = follow("position", [2000, 2000, 2000, 2000, 2000], 2 * ONE, SUM // 20, 200)
    positions = np.array([position for position, _, _ in seen])
    limited = sum(duty == 200 for _, duty, _ in seen)

    assert limited > 50
    # On its way the error is 1000 counts in the middle, so that a sum without an end would be ten times the limit.
    assert 1000 * limited / 20 > 10 * 200
    assert positions.max() < 2000 * 1.3


@pytest.mark.parametrize("reference", [2**31 - 1, -(2**31)])
@pytest.mark.parametrize("mode", ["position", "speed"])
def test_the_largest_numbers_do_not_overflow(mode: str, reference: int) -> None:
    seen = follow(mode, [reference], 2**24, 2**24, 5)

    assert {duty for _, duty, _ in seen[20:]} == {5 if reference > 0 else -5}


def running(board: Board) -> None:
    board.claim()
    board.ask("gains", kp=ONE, ki=0, limit=512)
    board.ask("enable", mode=MODES["position"])
    board.ask("sampling", period=1, block=1)
    for _ in range(5):
        board.send("reference", reference=10**6)
        board.run(ms=10)
    assert board.look().duty == 0.5


def test_nothing_moves_before_the_first_reference_and_without_samples() -> None:
    with Board() as board:
        board.claim()
        board.ask("gains", kp=ONE, ki=SUM, limit=512)
        board.ask("enable", mode=MODES["speed"])
        board.ask("sampling", period=1, block=1)
        board.run(ms=200)
        assert board.look().pwm_rises == 0
        assert board.status()["state"] == STATES["operation_enabled"]
        assert board.ask("sampling", period=0, block=0)["refusal"] == REFUSALS["state"]


def test_a_host_that_falls_silent_ends_the_law_after_51_ms() -> None:
    with Board() as board:
        running(board)
        board.send("reference", reference=10**6)
        board.run(ms=100)
        view = board.look()
        assert (int(view.pwm_high) - int(view.received)) / MS <= 51
        assert not view.enable
        assert board.status()["faults"] == FAULTS["watchdog"]


def test_stop_and_a_duty_end_the_law_at_once_and_references_bring_it_back_in_no_way() -> None:
    with Board() as board:
        running(board)
        board.send("duty", duty=0)
        board.run(ms=2)
        assert board.look().duty == 0
        assert board.ask("reference", reference=10**6)["refusal"] == REFUSALS["state"]
        board.run(ms=5)
        assert board.look().duty == 0
    with Board() as board:
        running(board)
        sent = board.look().cycle
        board.send("stop")
        board.run(ms=5)
        assert (board.look().pwm_high - sent) / MS < 2
        assert board.ask("reference", reference=10**6)["refusal"] == REFUSALS["state"]


def test_a_law_against_a_blocked_shaft_is_a_stall() -> None:
    with Board() as board:
        board.block()
        running(board)
        for _ in range(320):
            board.send("reference", reference=10**6)
            board.run(ms=10)
        assert board.status()["faults"] == FAULTS["stall"]
        assert board.look().duty == 0


def test_the_delay_that_a_run_with_the_law_states_is_the_firmware_s() -> None:
    """As that of a batch: the encoder serves as a clock, and each count moves the duty."""
    rate = 29_370
    with Board(around=motor(step=4)) as board:
        board.claim()
        board.ask("gains", kp=ONE // 32, ki=SUM // 2048, limit=1024)
        board.ask("enable", mode=MODES["position"])
        board.send("reference", reference=0)
        board.run(ms=1)
        begun = board.look().cycle
        board.move_encoder(rate, rate)
        board.ask("sampling", period=2, block=1)
        duty, changed = board.look().duty, []
        while len(changed) < 72:
            if len(changed) % 8 == 0:
                board.send("reference", reference=0)
            while board.look().duty == duty:
                board.let_pass(0, cycles=4)
            duty = board.look().duty
            changed.append(((board.look().cycle - begun) / CYCLES, round(duty * 1024)))
        board.run(ms=20)
        blocks = [values for message, values in board.heard if message.name == "block"]
    latched = {
        duty: position / rate
        for block in blocks
        for duty, position in zip(
            block["duty"], block["position"] + np.cumsum([0, *block["delta"]]), strict=True
        )
    }
    delays = [at - latched[duty] for at, duty in changed if duty in latched][:64]
    assert len(delays) == 64
    # As with a batch to 1.2 us; the encoder's interrupts make it 4 us longer here, and the law's time hangs on its numbers.
    assert np.mean(delays) - 0.5 / rate == pytest.approx(LATCH_TO_LAW, abs=10e-6)


# Runs


def run(**settings: Any) -> tuple[Any, Any]:
    bench = Bench()
    experiment = Experiment(
        signal=Square(low=-1, high=1, frequency=1.0),
        controller=Pi(kp=6, ki=4),
        duration=3,
        sample_time=0.001,
        **{key: each for key, each in settings.items() if key == "limits"},
    )
    with bench.rig(**{key: each for key, each in settings.items() if key != "limits"}) as rig:
        recording = bench.run(experiment, rig)
        status = bench.board.status()
    assert recording.stopped.reason == "finished", recording.stopped
    assert status["received_gaps"] == status["crc_bad"] == status["tx_lost"] == status["refused"] == 0
    return recording, bench


def test_a_run_lets_the_board_compute_the_law_of_its_experiment() -> None:
    recording, bench = run(limits=Limits(voltage=5.0))

    assert dict(recording.info.settings)["law"] == "the board's"
    t, counts = recording["counts"].t, recording["counts"].values
    assert len(t) == 3000
    assert np.allclose(np.diff(t), 0.001, rtol=0, atol=1e-9)
    assert np.array_equal(recording["applied"].values, recording["commanded"].values)
    assert np.abs(recording["applied"].values).max() == math.floor(5 / 12 * 1024) / 1024 * 12
    # The sum is 4 V/(rad s) 2 rad 0.1 s = 0.8 V when the shaft arrives: 0.8 V over 6 V/rad, and friction's 0.16 V.
    assert abs(counts[950] * 2 * np.pi / 2048 + 1) < 0.2
    assert abs(counts[1450] * 2 * np.pi / 2048 - 1) < 0.2
    result = identify(measure(recording), structure="first_order_coulomb")
    truth = bench.board.motor.truth
    for name in ("gain", "time_constant", "coulomb_voltage"):
        # Twice the 95 % interval: 4 standard deviations.
        assert abs(truth[name] - result[name].value) < 2 * result[name].half_width, name


def test_the_computer_computes_the_law_where_the_board_is_not_to() -> None:
    board, computer = run()[0], run(batch=False)[0]

    assert "law" not in dict(computer.info.settings)
    # The same but for the delays: the board gets the reference up to a block of 8 ms later, the computer the samples.
    ends = [950, 1450, 1950]
    assert np.allclose(board["counts"].values[ends], computer["counts"].values[ends], atol=0.05 * 2048 / 6.28)


@pytest.mark.parametrize(
    ("controller", "sample_time", "limits"),
    [
        (Pid(kp=6), 0.001, Limits()),
        (Pi(kp=6), 0.004, Limits()),
        (Pi(kp=-6), 0.001, Limits()),
        (Pi(kp=1e6), 0.001, Limits()),
        (Pi(kp=6, ki=1e-6), 0.001, Limits()),
        (Pi(kp=6), 0.001, Limits(slew=100.0)),
        (Pi(kp=6), 0.001, Limits(start=Outputs(voltage=0.5))),
    ],
    ids=["pid", "slow", "negative", "too large", "too small", "slew", "start"],
)
def test_what_the_board_can_not_do_the_computer_does(
    controller: Any, sample_time: float, limits: Limits
) -> None:
    bench = Bench()
    with bench.rig() as rig:
        bench.run(
            Experiment(
                signal=Step(final=0.1),
                controller=controller,
                duration=0.1,
                sample_time=sample_time,
                limits=limits,
            ),
            rig,
        )
        assert "law" not in dict(rig.info.settings)


def test_a_guard_that_stops_a_run_ends_the_board_s_law() -> None:
    bench = Bench()
    with bench.rig() as rig:
        experiment = Experiment(
            signal=Step(final=1000.0),
            controller=Pi(kp=6),
            duration=2,
            sample_time=0.001,
            limits=Limits(travel=30.0),
        )
        recording = bench.run(experiment, rig)
        bench.board.run(ms=5)

        assert recording.stopped.reason == "fault"
        assert "law" in dict(recording.info.settings)
        assert bench.board.look().enable == 0
