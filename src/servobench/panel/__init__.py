"""The front panel: a page in a browser from which a motor is driven, seen, recorded and identified.

`server` serves the page in `static`, `session` is what it is about, `live_process` fits while the motor runs, `work` identifies
in a process of its own. It uses `lab`, `report`, `identification`, `rig`, `recordings`, `systems` and `core`.
"""
