"""The conformance test of the rig's protocol: what an implementer of another board runs against his own.

`session` talks to the board, and says things that no host should; `checks` are what holds at rest, `driven` what turns the motor;
`base` has what they are made of, `__main__` the command.
"""
