"""Write examples/logger.csv: what a data logger has of a motor, made by the twin; a test holds the file equal to this.

Five seconds of random steps at 200 samples a second: a time, a voltage, and an angle in degrees in steps of an encoder.
"""

from pathlib import Path

import servobench as sb

FILE = Path(__file__).resolve().parent.parent / "examples" / "logger.csv"


def table() -> str:
    """Return the text of the file."""
    steps = sb.PRBS(low=-6, high=6, order=6, bit_time=0.08, seed=3)
    with sb.connect("twin", disc_inertia="30 g*cm^2", coulomb_torque="1 mN·m") as motor:
        run = sb.run(sb.Experiment(signal=steps, duration=5, sample_time=0.005), motor)
    angle = run["counts"].values * 360 / 2048
    rows = zip(run["applied"].t, run["applied"].values, angle, strict=True)
    return "time,voltage,angle\n" + "".join(f"{t:.3f},{u:g},{y:.3f}\n" for t, u, y in rows)


if __name__ == "__main__":
    FILE.write_text(table(), encoding="utf-8")
