"""The kind `export`: formats of an identified motor for other programs, one file for each.

`summary` is a result, new or read from a file; `first_order` reduces it to the motor that controllers are tuned for; `base`
defines what a target has to implement. It uses `identification`, `systems` and `core`.
"""
