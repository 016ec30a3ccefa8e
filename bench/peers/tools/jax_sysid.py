"""jax-sysid: its linear model with one state, by L-BFGS, on signals scaled by their standard deviations."""

import jax
from jax_sysid.models import LinearModel
from record import Answer, Array, both_ways, state_space_answer

jax.config.update("jax_enable_x64", True)


def lbfgs(u: Array, y: Array, sample_time: float) -> Answer:
    model = LinearModel(1, 1, 1, feedthrough=True)
    model.loss(rho_x0=1e-8, rho_th=1e-10)
    model.optimization(adam_epochs=0, lbfgs_epochs=1000, iprint=-1)
    model.fit((y / y.std()).reshape(-1, 1), (u / u.std()).reshape(-1, 1))
    a, b, c, d = model.ssdata()
    scale = y.std() / u.std()
    return state_space_answer(a, b, scale * c, scale * d, sample_time)


METHODS = both_ways("jax-sysid LinearModel, 1 state", lbfgs)
