"""Live identification as the panel feeds it: a device's rows, with a counter that wraps, lost rows and rows without a value."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from servobench.core.channels import Channel, DeviceInfo
from servobench.core.errors import UsageError
from servobench.panel.live import LiveFit
from tests.datasets import QUANTUM, square
from tests.rig.motor.reference import Truth, march

STEP = 0.001
BLOCK = 33  # rows of a look, thirty looks a second
INFO = DeviceInfo(
    name="motor",
    channels=(
        Channel(name="voltage", unit="V"),
        Channel(name="counts", unit="counts", counter_bits=16, counts_per_rev=2048.0),
    ),
)
Array = NDArray[np.float64]


def columns(seconds: float, seed: int = 1, fault: tuple[float, float] | None = None) -> dict[str, Array]:
    """A second at rest, then the paper's square; zero volts from one time to another where there is a fault."""
    t = STEP * np.arange(round(seconds / STEP))
    u = np.where(t < 1.0, 0.0, square(t, 0.1))
    if fault is not None:
        u[(t >= fault[0]) & (t < fault[1])] = 0.0
    angle = march(Truth(), u, STEP, step=5e-5, torque_noise=1e-6, seed=seed)[:, 2]
    counts = (np.floor(angle / QUANTUM) + 2**15) % 2**16 - 2**15
    return {"t": t, "applied": u, "counts": counts}


def looked_at(live: LiveFit, rows: dict[str, Array], lost: slice = slice(0, 0)) -> list[dict[str, object]]:
    """All messages, the rows in `lost` never seen."""
    messages = []
    n, count = 0, len(rows["t"])
    while n < count:
        if lost.start <= n < lost.stop:
            n = lost.stop
            continue
        end = min(n + BLOCK, count)
        message = live.take({name: x[n:end] for name, x in rows.items()}, first=n)
        n = end
        messages += [message] if message else []
    return messages


def truth() -> dict[str, float]:
    r, l, k, j, b, tc = Truth()
    slow = max(-1 / np.roots([j * l, j * r + l * b, r * b + k * k]).real)
    return {"gain": k / (r * b + k * k), "time_constant": slow, "coulomb_voltage": tc * r / k}


def check_near(message: dict[str, object], deviations: float = 3.5) -> None:
    parameters = message["parameters"]
    assert isinstance(parameters, dict)
    for name, expected in truth().items():
        low, high = parameters[name]["interval"]
        assert abs(parameters[name]["value"] - expected) <= deviations * (high - low) / (2 * 1.96), name


def test_five_messages_a_second_that_come_to_the_motors_values() -> None:
    """The counter wraps eight times in these twelve seconds."""
    messages = looked_at(LiveFit(INFO, STEP), columns(12.0))
    # Rows come 33 ms at a time, so that 0.2 s are seven looks, 231 ms.
    assert len(messages) == pytest.approx(12.0 / 0.231, abs=1)
    assert messages[0]["parameters"] == {}
    assert messages[0]["enough"] is False
    last = messages[-1]
    assert last["kind"] == "live"
    assert 12_000 - 8 * BLOCK < last["samples"] <= 12_000  # type: ignore[operator]
    assert last["white"] is True
    parameters = last["parameters"]
    assert isinstance(parameters, dict)
    assert {name: one["unit"] for name, one in parameters.items()} == {
        "gain": "rad/(s·V)",
        "time_constant": "s",
        "coulomb_voltage": "V",
        "delay": "s",
    }
    check_near(last)


def test_it_is_enough_when_the_wished_interval_is_reached() -> None:
    live = LiveFit(INFO, STEP, {"time_constant": 0.002})
    messages = looked_at(live, columns(12.0))
    enough = [bool(message["enough"]) for message in messages]
    assert not any(enough[:5])
    assert enough[-1]
    for message in messages:
        if message["enough"]:
            low, high = message["parameters"]["time_constant"]["interval"]  # type: ignore[index]
            assert high - low <= 2 * 0.002 * high
    live.set_wish({"time_constant": 1e-6})
    assert live.message()["enough"] is False
    live.set_wish(None)
    assert live.message()["enough"] is False


def test_lost_rows_and_a_fault_do_no_harm() -> None:
    """Zero volts for two seconds, as a guard's stop puts out, and 1.5 s of rows that nobody saw."""
    rows = columns(14.0, fault=(5.0, 7.0))
    messages = looked_at(LiveFit(INFO, STEP), rows, slice(9009, 10_527))
    assert messages[-1]["samples"] == 14_000 - (10_527 - 9009)
    check_near(messages[-1])


def test_rows_without_a_value_are_left_out() -> None:
    rows = columns(8.0)
    rows["counts"] = rows["counts"].copy()
    rows["counts"][3000:3010] = np.nan
    messages = looked_at(LiveFit(INFO, STEP), rows)
    assert messages[-1]["samples"] <= 7990
    check_near(messages[-1])


def test_residuals_come_for_each_row_and_are_small() -> None:
    """Once there is a model, what it leaves over is the encoder's rounding and what the torque does: a few counts."""
    live, rows = LiveFit(INFO, STEP), columns(8.0)
    residuals = []
    for n in range(0, 8000, BLOCK):
        part = {name: x[n : n + BLOCK] for name, x in rows.items()}
        live.take(part, first=n)
        residuals.append(live.residuals(n, n + len(part["t"])))
        assert live.reached == n + len(part["t"])
    last = np.concatenate(residuals)
    assert len(last) == 8000
    assert np.isnan(last[:1000]).all()
    assert np.isfinite(last[-1000:]).all()
    assert np.abs(last[-1000:]).max() < 20 * QUANTUM


@pytest.mark.parametrize("delay", [0.0, -0.004])
def test_a_residual_is_that_of_its_own_row(delay: float) -> None:
    """A count that is wrong in one row shows in that row, also where residuals are known later, and after lost rows."""
    rows, wrong, lost = columns(9.0), (4321, 8000), slice(6006, 6600)
    rows["counts"] = rows["counts"].copy()
    rows["counts"][list(wrong)] += 300
    live = LiveFit(replace(INFO, delay=delay), STEP)
    found = np.full(9000, np.nan)
    for n in range(0, 9000, BLOCK):
        if lost.start <= n < lost.stop:
            continue
        before = live.reached
        live.take({name: x[n : n + BLOCK] for name, x in rows.items()}, first=n)
        # What waits is a sample or two, but for the time after lost rows, until there is a start state.
        assert live.reached >= n + BLOCK - 5 or n >= lost.stop
        found[before : live.reached] = live.residuals(before, live.reached)
    assert np.isnan(found[lost]).all()
    for row in wrong:
        assert int(np.nanargmax(found[row - 500 : row + 500])) == 500
        assert found[row] == pytest.approx(300 * QUANTUM, abs=20 * QUANTUM)
    assert np.isfinite(found[8200:-5]).all()


def test_an_input_holds_from_when_the_device_had_taken_it() -> None:
    """Voltages that are taken 0.1 to 0.3 ms after their sample: the delay is the winding's 0.138 ms, not that and 0.2 ms.

    The motor is marched in steps of 0.1 ms, so that the voltage changes where `written` says.
    """
    fine, count = 1e-4, 8000
    t = STEP * np.arange(count)
    late = np.random.default_rng(5).integers(1, 4, count)
    u = np.where(t < 0.2, 0.0, square(t, 0.1))
    held = np.empty(10 * count)
    for k in range(count):
        held[10 * k : 10 * k + late[k]] = u[k - 1] if k else 0.0
        held[10 * k + late[k] : 10 * (k + 1)] = u[k]
    angle = march(Truth(), held, fine, step=5e-5, torque_noise=1e-6, seed=5)[::10, 2]
    counts = (np.floor(angle / QUANTUM) + 2**15) % 2**16 - 2**15
    written = t + fine * late
    rows = {"t": t, "applied": u, "counts": counts, "handed": written - 3e-6, "written": written}
    live = LiveFit(replace(INFO, timing="host"), STEP)
    told = looked_at(live, rows)[-1]["parameters"]
    assert isinstance(told, dict)
    low, high = told["delay"]["interval"]
    sd = (high - low) / 2 / 1.96
    winding = Truth().inductance / Truth().resistance
    assert abs(told["delay"]["value"] - winding) < 3.5 * sd
    assert 5 * sd < 2 * fine  # the 0.2 ms would be seen


def test_a_device_that_does_not_say_its_resolution_is_refused() -> None:
    with pytest.raises(UsageError, match="counts per revolution"):
        LiveFit(DeviceInfo(name="motor", channels=(Channel(name="counts", unit="counts"),)), STEP)
