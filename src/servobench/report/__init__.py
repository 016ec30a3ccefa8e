"""Reports: a result in one HTML file that needs no network.

`document` is the report, `html` fills the templates, `figures`, `tables` and `summary` make their contents. Exercises use the
same templates. It uses `identification`, `rig`, `recordings`, `systems` and `core`, and identifies nothing itself.

Public: `Report`.
"""
