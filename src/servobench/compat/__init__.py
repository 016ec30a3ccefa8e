"""Stand-ins for other makers' software, so that programs written for it run without it.

`quanser` stands in for the package of that name, with a virtual QUBE-Servo. A stand-in is never the real thing, and says so. It
uses `rig`, whose motor it turns.
"""
