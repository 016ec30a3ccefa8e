"""Reports: a result for people to read, in one file that opens from disk without a network.

`document` is the report, `html` fills the templates, `figures`, `tables` and `summary` make what stands in them. Exercises use
the same templates. It uses `identification`, `rig`, `recordings`, `systems` and `core`, and finds nothing out itself.

Public: `Report`.
"""
