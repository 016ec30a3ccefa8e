"""The motor with friction as a scan of JAX's, imported by the Python of the peers' environment for
bench/speed.py.

Reads two lines of JSON: the coefficients (12,) as in twin.c, and the voltages (N,), within their limit. Then it does one
simulation for each line that comes, and prints the processor time that it took [s]; the first one compiles.
"""

import json
import sys
import time

import jax
import jax.numpy as jnp

jax.config.update("jax_enable_x64", True)


def main() -> None:
    """Answer each line with a time."""
    a00, a01, b0, a10, a11, b1, t0, t1, tb, c1, g, q = json.loads(sys.stdin.readline())
    u = jnp.asarray(json.loads(sys.stdin.readline()))

    def step(state, v):  # type: ignore[no-untyped-def]
        i, w, theta = state
        free = a10 * i + a11 * w + b1 * v
        d = jnp.clip(free, -c1, c1)
        new = (a00 * i + a01 * w + b0 * v + g * d, free - d, theta + t0 * i + t1 * w + tb * v - q * d)
        return new, new

    simulate = jax.jit(lambda voltages: jax.lax.scan(step, (0.0, 0.0, 0.0), voltages)[1])
    for _ in sys.stdin:
        start = time.process_time()
        jax.block_until_ready(simulate(u))
        print(time.process_time() - start, flush=True)
