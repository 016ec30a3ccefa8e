"""python-control: Markov parameters by least squares, then the eigensystem realisation (ERA) with one state.

Both are called without a sample time: with one, the input matrix would be scaled by it and the direct term not.
"""

import control
from record import Answer, Array, both_ways, state_space_answer

TERMS = 100  # of the impulse response: 0.2 s, two time constants; more of them make the regression ill-conditioned


def era(u: Array, y: Array, sample_time: float) -> Answer:
    markov = control.markov(y, u, TERMS)
    model, _ = control.eigensys_realization(markov, 1, m=TERMS // 2 - 1, n=TERMS // 2 - 1)
    return state_space_answer(model.A, model.B, model.C, model.D, sample_time)


METHODS = both_ways("python-control markov + ERA, order 1", era)
