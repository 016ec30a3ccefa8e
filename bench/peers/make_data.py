"""The data that every peer gets: a motor with Coulomb friction behind an encoder, simulated from the equations alone.

    τ dω/dt = -ω + K (u - u_c sgn ω),   dθ/dt = ω,   K = k/(R b + k²),   τ = J R/(R b + k²),   u_c = T_c R/k

Nothing of servobench is imported: the simulator is a route of its own. `python make_data.py --runs 30 --folder data` writes, for
each set, `<set>.npz` (t, u, counts), `<set>.mat` and `csv/<set>_<run>.csv` for MATLAB, and `truth.csv` with what is to be found.
"""

from __future__ import annotations

import argparse
import csv
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SAMPLE_TIME = 0.002  # s
SAMPLES = 5000
SUBSTEPS = 20  # a sample: the torque's kicks come at their ends
QUANTUM = 2 * np.pi / 2048  # rad
SEED = 20_26


@dataclass(frozen=True, kw_only=True)
class Kind:
    """A set of data: the square wave's levels [V], the speed at the start [rad/s], the random torque [N·m/√Hz, two-sided]."""

    high: float
    low: float
    start_speed: tuple[float, float]
    torque_noise: float = 0.0


SETS = {
    "coulomb": Kind(high=3.0, low=1.0, start_speed=(20.0, 70.0)),
    "disturbance": Kind(high=3.0, low=1.0, start_speed=(20.0, 70.0), torque_noise=1e-5),
    "reversals": Kind(high=3.0, low=-3.0, start_speed=(0.0, 0.0)),
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Motors:
    """Physical parameters in SI units; `inertia` and `motor_constant` are (R,), one for each run."""

    inertia: Array
    motor_constant: Array
    resistance: float = 8.4
    viscous_friction: float = 5e-6
    coulomb_torque: float = 1.5e-3

    @property
    def gain(self) -> Array:
        """K = k/(R b + k²) [rad/(s·V)]."""
        return self.motor_constant / self._damping

    @property
    def time_constant(self) -> Array:
        """τ = J R/(R b + k²) [s]."""
        return self.inertia * self.resistance / self._damping

    @property
    def coulomb_voltage(self) -> Array:
        """u_c = T_c R/k [V]."""
        return self.coulomb_torque * self.resistance / self.motor_constant

    @property
    def _damping(self) -> Array:
        return self.resistance * self.viscous_friction + self.motor_constant**2


@dataclass(frozen=True, kw_only=True, eq=False)
class Records:
    """One set of data: times (N,) [s], voltage (R, N) [V], counts (R, N), and what is to be found (R,)."""

    t: Array
    u: Array
    counts: NDArray[np.int64]
    gain: Array
    time_constant: Array


def piece(motors: Motors, h: Array, u: Array, angle: Array, speed: Array) -> tuple[Array, Array, Array]:
    """Return angle and speed after a time h (R,) at a constant voltage, or at the shaft's stop, and the time that is left then.

    Until it stops, the sign of the friction is constant and the solution is an exponential. A shaft at rest stays there
    while |u| <= u_c.
    """
    gain, lag, lost = motors.gain, motors.time_constant, motors.coulomb_voltage
    sense = np.where(speed != 0.0, np.sign(speed), np.where(np.abs(u) > lost, np.sign(u), 0.0))
    target = np.where(sense == 0.0, 0.0, gain * (u - lost * sense))
    end = target + (speed - target) * np.exp(-h / lag)
    stops = (speed != 0.0) & (speed * end < 0.0)
    until = h.copy()
    until[stops] = lag[stops] * np.log1p(-speed[stops] / target[stops])
    travelled = target * until - (speed - target) * lag * np.expm1(-until / lag)
    return angle + travelled, np.where(stops, 0.0, end), h - until


def simulate(motors: Motors, u: Array, angle: Array, speed: Array, kicks: Array | None = None) -> Array:
    """Return the angle (R, N) [rad] at each sample, before the voltage u (R, N) of that sample acts.

    `kicks` (R, N, SUBSTEPS) [rad/s] are added to the speed of a shaft that turns, at the end of each sub-step.
    """
    out = np.empty_like(u)
    step = np.full(len(u), SAMPLE_TIME / SUBSTEPS)
    for n in range(u.shape[1]):
        out[:, n] = angle
        for m in range(SUBSTEPS):
            angle, speed, left = piece(motors, step, u[:, n], angle, speed)
            if left.any():
                angle, speed, _ = piece(motors, left, u[:, n], angle, speed)
            if kicks is not None:
                speed = np.where(speed != 0.0, speed + kicks[:, n, m], 0.0)
    return out


def records(name: str, runs: int, seed: int = SEED, samples: int = SAMPLES) -> Records:
    """Return the runs of a set; each has a random stream of its own, so more runs don't change the first ones.

    J and k vary by ±5 %, the phase of the square wave by a period, the start by a count; equal sets of numbers for equal seeds.
    """
    kind = SETS[name]
    streams = [np.random.default_rng([seed, list(SETS).index(name), run]) for run in range(runs)]
    inertia, constant, phase, count, start = (np.array([s.random() for s in streams]) for _ in range(5))
    motors = Motors(inertia=2.1e-5 * (0.95 + 0.1 * inertia), motor_constant=0.042 * (0.95 + 0.1 * constant))
    t = np.arange(samples) * SAMPLE_TIME
    u = np.where((0.4 * t + phase[:, None]) % 1.0 < 0.5, kind.high, kind.low)
    speed = kind.start_speed[0] + (kind.start_speed[1] - kind.start_speed[0]) * start
    kicks = None
    if kind.torque_noise:
        sd = kind.torque_noise / motors.inertia * np.sqrt(SAMPLE_TIME / SUBSTEPS)
        kicks = sd[:, None, None] * np.array([s.standard_normal((samples, SUBSTEPS)) for s in streams])
    angle = simulate(motors, u, count * QUANTUM, speed, kicks)
    counts = np.floor(angle / QUANTUM).astype(np.int64)
    return Records(t=t, u=u, counts=counts, gain=motors.gain, time_constant=motors.time_constant)


def write(folder: Path, runs: int, seed: int = SEED, samples: int = SAMPLES) -> None:
    """Write all sets and what is to be found into a folder."""
    (folder / "csv").mkdir(parents=True, exist_ok=True)
    with open(folder / "truth.csv", "w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(["set", "run", "gain", "time_constant"])
        for name in SETS:
            data = records(name, runs, seed, samples)
            for run in range(runs):
                table.writerow([name, run, repr(float(data.gain[run])), repr(float(data.time_constant[run]))])
            _write_set(folder, name, data)


def _write_set(folder: Path, name: str, data: Records) -> None:
    from scipy.io import savemat

    arrays = {"t": data.t, "u": data.u, "counts": data.counts}
    np.savez_compressed(folder / f"{name}.npz", **arrays)
    savemat(folder / f"{name}.mat", {**arrays, "counts": data.counts.astype(float), "quantum": QUANTUM})
    for run in range(len(data.u)):
        rows = np.column_stack([data.t, data.u[run], data.counts[run]])
        path = folder / "csv" / f"{name}_{run:03d}.csv"
        np.savetxt(
            path, rows, fmt=["%.3f", "%g", "%d"], delimiter=",", header="time,voltage,counts", comments=""
        )


def main() -> None:
    """Write the data for the command line."""
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("--runs", type=int, default=30)
    words.add_argument("--seed", type=int, default=SEED)
    words.add_argument("--folder", type=Path, default=Path(__file__).resolve().parent / "data")
    asked = words.parse_args()
    write(asked.folder, asked.runs, asked.seed)


def smallest() -> list[str]:
    """Write all sets of one short run into a folder that is gone afterwards, and return the names of the files."""
    with tempfile.TemporaryDirectory() as folder:
        write(Path(folder), 1, samples=500)
        return sorted(path.name for path in Path(folder).iterdir())


if __name__ == "__main__":
    main()
