"""Many motors: every recording under a folder or an address becomes a row of a table that can be interrupted and continued.

`source` lists the recordings, `name_pattern` makes columns of their names, `settings` says how each is identified, `row` writes
a result as a row, `worker` and `pool` do that in processes that may die, `parts` keeps the rows, and `identification` puts
these together. `limits` and `decision` say pass, fail or undecided, `outliers` finds the odd motors, `table`, `figures` and
`page` are what people open, `repeatability` judges the test stand, and `watch` takes files as they come. `ensemble` identifies
simulated motors whose truth is known; `ensemble_figures` and `ensemble_page` are their report. It uses `report`,
`identification`, `rig`, `recordings` and `core`.
"""
