"""Many simulated motors at once, alike but for their tolerances, all driven by the same experiment.

`tolerances` says how far each parameter may be off and draws the motors, `motors` has them with their gain and time constant,
`lanes` and `kernels` simulate them, `driving` is the voltage or the reference that they all get, `simulation` shares them out
over threads, `outcomes` reads off what matters of each, `sensitivity` says which tolerance matters, and `ensemble` puts these
together.
"""
