"""The same ensemble by JAX, in the peers' environment: one line with the processor time [s] for each line that is read.

The file that it is called with holds `c` (14, M), as in bench/ensemble_parts/lanes.c, and the voltages `u` (N,).
"""

import sys
import time

import numpy as np


def main(file: str) -> None:
    """Simulate all motors at each line of standard input; the first time it compiles."""
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)  # type: ignore[no-untyped-call]
    given = np.load(file)
    u = jnp.asarray(given["u"])

    def one(c):  # type: ignore[no-untyped-def]
        def step(x, volts):  # type: ignore[no-untyped-def]
            i, w, theta = x
            counts = jnp.floor(theta * c[13]).astype(jnp.int32).astype(jnp.int16)
            v = jnp.clip(volts, -c[12], c[12])
            free = c[3] * i + c[4] * w + c[5] * v
            d = jnp.clip(free, -c[9], c[9])
            theta = theta + (c[6] * i + c[8] * v) + (c[7] * w - c[11] * d)
            return (c[0] * i + c[1] * w + c[2] * v + c[10] * d, free - d, theta), counts

        return jax.lax.scan(step, (0.0, 0.0, 0.0), u)

    every, c = jax.jit(jax.vmap(one, in_axes=1)), jnp.asarray(given["c"])
    for _ in sys.stdin:
        begun = time.process_time()
        jax.block_until_ready(every(c))
        print(time.process_time() - begun, flush=True)
