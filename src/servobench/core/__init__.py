"""What every room uses and nobody has to think about: units, errors, settings.

`channels` has the nouns that pass between a device and all else, `units` and `rounding` are how numbers are read and said,
`estimate` is one with its uncertainty, `numbers` checks single ones. `errors` are the mistakes, `finding` is what there is to
know that is none, `finding_codes` what each code of one means, `parameter_names` how each parameter is called and written.
`settings` and `registry` make a folder of members a kind, `compiled` compiles kernels, `json_numbers` and `toml` are for files,
`arguments` checks what a function was given, `palette` and `plotting` give pictures their colours and axes. It uses no other
room.
"""
