"""The recording of one motor of an ensemble: a run of a twin that is this motor.

It isn't taken from the lanes. They are exact to first order where the shaft turns back, which an estimator sees: its residuals
grow, and its intervals with them. A run has each switch at its time, and costs less than identifying it.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from servobench.recordings.recording import Recording
from servobench.rig.devices.twin import Twin, TwinSettings
from servobench.rig.experiment import Experiment
from servobench.rig.loop.run import run


def recording_of(
    parameters: Mapping[str, float], number: int, experiment: Experiment, twin: TwinSettings, seed: int
) -> Recording:
    """Return the recording of the motor with these parameters, number `number` of an ensemble with that seed.

    Its noise is that of a run, another one for each motor.
    """
    own = twin.model_copy(
        update={
            **{name: value for name, value in parameters.items() if name != "inertia"},
            "rotor_inertia": parameters["inertia"],
            "hub_inertia": 0.0,
            "disc_inertia": 0.0,
        }
    )
    noise_seed = int(np.random.SeedSequence((seed, number)).generate_state(1)[0])
    with Twin(own) as device:
        return run(experiment.model_copy(update={"seed": noise_seed, "name": f"motor {number}"}), device)
