"""SIPPY (sippy-unipi): ARX and output error on speed with one pole and two numerator terms, and N4SID with one state."""

from record import Answer, Array, answer_of, both_ways, state_space_answer
from sippy_unipi import system_identification


def arx(u: Array, y: Array, sample_time: float) -> Answer:
    model = system_identification(y, u, "ARX", ARX_orders=[1, 2, 1], tsample=sample_time)
    return _answer(model, sample_time)


def output_error(u: Array, y: Array, sample_time: float) -> Answer:
    model = system_identification(y, u, "OE", OE_orders=[2, 1, 1], tsample=sample_time)
    return _answer(model, sample_time)


def n4sid(u: Array, y: Array, sample_time: float) -> Answer:
    model = system_identification(y, u, "N4SID", SS_fixed_order=1, SS_D_required=True, tsample=sample_time)
    return state_space_answer(model.A, model.B, model.C, model.D, sample_time)


def _answer(model, sample_time: float) -> Answer:
    poles = sorted(model.G.poles(), key=abs)
    return answer_of(poles[-1], model.G.dcgain(), sample_time)


METHODS = {
    **both_ways("sippy ARX(1,2,1)", arx),
    **both_ways("sippy OE(2,1,1)", output_error),
    **both_ways("sippy N4SID, order 1", n4sid, forward=True),
}
