"""What turns, and what turns it: the motor, the devices, the experiment and the loop that runs it in time.

`motor` is the physics of the twin and the data sheets, `devices` what takes a voltage and gives counts (with its guard and its
faults), `experiment` what is asked for, `clock` who keeps the time, `loop` what carries it out, in a process of its own where it
has to. `lost_device` has the errors that bring the recording along, `lateness` says how late the samples of a run were. It uses
`recordings`, which it writes, `systems`, whose signals and control laws it runs, and `core`.

Public: `Experiment`, `connect`, `run`.
"""
