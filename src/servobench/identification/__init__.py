"""Identification: from a data set to a result with intervals, doubts and reasons.

From the bottom up: `models` predict a motor's response from parameters, `estimators` fit them, `uncertainty` computes intervals
that cover; `result` is the noun, which `plots` and `notebook` show at the prompt. `trust` tests for what could be wrong,
`choice` selects structure and noise model, `motor_parameters` and `reconciliation` compare with data sheets and claims,
`simulation` simulates and predicts, `comparison` compares models. `identify` is the verb that calls them in order; `design`,
`honest`, `watch` and `why` build on it; `live` is the estimate while rows still come. It uses `rig`, `recordings`, `systems` and
`core`; from the physics of the motor, `models` only use the data sheets.

Public: `identify`, `Result`, `compare`, `design`, `honest`, `validate`, `simulate`, `predict`, `residuals`, `reconcile`, `why`.
"""
