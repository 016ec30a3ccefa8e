"""The words between the host and the open rig: frames, messages and their table, conversations at a serial port.

`conformance` tests whether a board of another maker speaks them.
"""
