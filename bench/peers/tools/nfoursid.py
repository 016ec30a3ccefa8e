"""nfoursid: its subspace method (PO-MOESP) with one state."""

import pandas as pd
from nfoursid.nfoursid import NFourSID
from record import Answer, Array, both_ways, state_space_answer


def n4sid(u: Array, y: Array, sample_time: float) -> Answer:
    method = NFourSID(
        pd.DataFrame({"u": u, "y": y}), output_columns=["y"], input_columns=["u"], num_block_rows=20
    )
    method.subspace_identification()
    model, _ = method.system_identification(rank=1)
    return state_space_answer(model.a, model.b, model.c, model.d, sample_time)


METHODS = both_ways("nfoursid, order 1", n4sid, forward=True)
