"""The basics that every room uses: units, errors, settings.

`channels` has the data types between a device and the rest, `units` and `rounding` read and print numbers, `estimate` is a number
with its uncertainty, `numbers` checks single numbers, `crossing` finds where a function is zero, `matrix_exponential` and
`probability` have what nearly every command needs of SciPy, and `runs` finds samples that follow each other. `errors` has the
exceptions, `finding` the messages that aren't errors, `finding_codes` the meaning of each code, `parameter_names` the names and
symbols of the parameters. `settings` and `registry` turn a folder of members into a kind, `compiled` compiles kernels
(`kernel_sources` says from what), `json_numbers` and `toml` are for files, `arguments` checks a function's arguments, `palette`
and `plotting` have colours and axes, `processors` counts what work may be shared out over. It uses no other room.
"""
