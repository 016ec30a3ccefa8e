"""The kind `export`: forms in which other programs take an identified motor, each in the file of its name.

`summary` is a result, just found or read from a file; `first_order` makes of it the motor that controllers are tuned for; `base`
is what a form has to fulfil. It uses `identification`, `systems` and `core`.
"""
