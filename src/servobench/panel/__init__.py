"""The front panel: a page in a browser to drive, watch, record and identify a motor.

`server` serves the page in `static`, `session` is its state, `live_process` fits while the motor runs, `work` identifies
in a process of its own. It uses `lab`, `report`, `identification`, `rig`, `recordings`, `systems` and `core`.
"""
