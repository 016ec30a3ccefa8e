"""The acceptance test of a bench: checks that turn the motor only as far as stopping was proved before.

`bench` runs what a check asks for and keeps the order safe, `checks` has the checks, a file each, `seen` is what a
recording shows of the shaft, `acceptance` carries all of them out.
"""
