"""The rig: the motor, the devices, the experiment and the loop that runs it in time.

`motor` has the physics of the twin and the data sheets, `devices` take a voltage and give counts (with their guard and faults),
`experiment` describes a run, `clock` keeps the time, `wire` has the words that the open rig and
we talk in, `loop` carries the run out, in a process of its own if necessary.
`ensemble` simulates many motors with tolerances at once.
`lost_device` has the errors that carry the recording so far, `lateness` says how late the samples of a run were, and
`commission` has the acceptance test of a bench. It uses `recordings`, which it writes, `systems`, whose signals and control
laws it runs, and `core`.

Public: `Experiment`, `connect`, `ensemble`, `run`.
"""
