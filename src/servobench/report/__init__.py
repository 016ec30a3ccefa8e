"""Reports: a result to read, in one file that opens from disk without a network.

`document` is the report, `html` fills the templates, `figures`, `tables` and `summary` make their contents. Exercises use the
same templates. It uses `identification`, `rig`, `recordings`, `systems` and `core`, and identifies nothing itself.

Public: `Report`.
"""
