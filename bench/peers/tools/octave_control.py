"""Octave's control package (SLICOT): ARX and N4SID on speed. One start of Octave for each fit; the time is Octave's own."""

import subprocess
import tempfile
from pathlib import Path

import numpy as np
from record import Answer, Array, NoAnswer, answer_of, both_ways

SCRIPT = Path(__file__).with_name("octave_fit.m")


def _fit(method: str):
    def fit(u: Array, y: Array, sample_time: float) -> Answer:
        with tempfile.TemporaryDirectory() as folder:
            data = Path(folder) / "data.txt"
            np.savetxt(data, np.column_stack([u, y]), fmt="%.17g")
            words = ["octave-cli", "--norc", "--quiet", str(SCRIPT), method, str(data), repr(sample_time)]
            ended = subprocess.run(words, capture_output=True, text=True)
        if ended.returncode != 0:
            raise NoAnswer(ended.stderr.strip().splitlines()[-1] if ended.stderr.strip() else "Octave failed")
        pole, gain, seconds = (float(word) for word in ended.stdout.split()[-3:])
        found = answer_of(pole, gain, sample_time)
        return Answer(gain=found.gain, time_constant=found.time_constant, seconds=seconds)

    return fit


METHODS = {
    **both_ways("Octave control arx(1,2)", _fit("arx")),
    **both_ways("Octave control n4sid, order 1", _fit("n4sid"), forward=True),
}
