"""Laws, devices and shafts for tests of control."""

from collections.abc import Callable
from typing import Any

import numpy as np

from servobench.core.channels import Array, Channel, DeviceInfo, Sample
from servobench.systems.control.lead import Lead
from servobench.systems.control.open_loop import OpenLoop
from servobench.systems.control.pid import Pid
from servobench.systems.control.state_feedback import StateFeedback

LAWS: dict[str, Any] = {
    "open loop": OpenLoop(),
    "PID of the position": Pid(kp=3, ki=2, kd=0.1, b=0.7, c=0.3),
    "PD of the position": Pid(kp=3, kd=0.1),
    "PID of the speed": Pid(output="speed", kp=0.1, ki=1.5, kd=0.001, c=0.5),
    "P of the speed": Pid(output="speed", kp=0.1),
    "lead of the position": Lead(gain=2, zero=10, pole=80),
    "lead of the speed": Lead(output="speed", gain=0.1, zero=10, pole=80),
    "state feedback of the position": StateFeedback(position_gain=3, speed_gain=0.1),
    "state feedback of the position with integral": StateFeedback(
        position_gain=3, speed_gain=0.1, integral_gain=4
    ),
    "state feedback of the speed with integral": StateFeedback(
        output="speed", position_gain=0, speed_gain=0.05, integral_gain=1
    ),
}


def device(
    limit: float | None = 10.0, bits: int | None = 24, counts_per_rev: float | None = 2048.0
) -> DeviceInfo:
    """Return a device with an encoder, and a voltage up to a limit either way."""
    return DeviceInfo(
        name="shaft",
        channels=(
            Channel(name="voltage", unit="V", minimum=None if limit is None else -limit, maximum=limit),
            Channel(name="counts", unit="counts", counter_bits=bits, counts_per_rev=counts_per_rev),
        ),
    )


def sample(index: int, counts: int, sample_time: float) -> Sample:
    """Return the sample of a tick, at its scheduled time."""
    return Sample(index=index, time=index * sample_time, counts=counts)


def voltages(law: Any, reference: Array, counts: Array, sample_time: float, info: DeviceInfo) -> Array:
    """Return what a law wants at each tick (N,), for references and counts that don't depend on it."""
    state, found = law.start(sample_time, info), []
    for k, (r, n) in enumerate(zip(reference.tolist(), counts.tolist(), strict=True)):
        state, u = law.step(state, r, sample(k, int(n), sample_time))
        found.append(u)
    return np.array(found)


def closed_loop(
    law: Any,
    plant: Callable[[Array, float], Array],
    output: Callable[[Array], float],
    reference: Array,
    sample_time: float,
    info: DeviceInfo,
    scale: float,
) -> tuple[Array, Array]:
    """Return angles (N,) [rad] and voltages (N,) of a law around a plant: x' = plant(x, u), counts = floor(output(x) / scale)."""
    state, x = law.start(sample_time, info), np.zeros(2)
    channel = info.channel("voltage")
    low, high = (channel.minimum, channel.maximum) if channel else (None, None)
    angles, wanted = [], []
    for k, r in enumerate(reference.tolist()):
        angles.append(output(x))
        state, u = law.step(state, r, sample(k, int(np.floor(output(x) / scale)), sample_time))
        wanted.append(u)
        x = plant(x, float(np.clip(u, -np.inf if low is None else low, np.inf if high is None else high)))
    return np.array(angles), np.array(wanted)
