"""Many simulated motors at once, alike but for their tolerances, all driven by the same experiment.

`tolerances` says how far each parameter may be off and draws the motors, `motors` has them with their gain and time constant,
`lanes` and `kernels` simulate them, `simulation` drives them with the experiment and shares them out over threads, `outcomes`
reads off what matters of each, `sensitivity` says which tolerance matters, `records` runs one motor by itself, and `ensemble`
puts these together.
"""
