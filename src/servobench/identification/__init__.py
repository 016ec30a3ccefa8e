"""What the motor is, and how far to trust that: from a data set to a result with intervals, doubts and reasons.

From the bottom up: `models` say what a motor does with parameters, `estimators` fit them, `uncertainty` makes intervals that
cover, `result` is the noun, which `plots` and `notebook` show at the prompt. `trust` tries what could be wrong, `choice` picks
structure and noise model, `motor_parameters` and `reconciliation` compare with data sheets and claims, `simulation` predicts,
`comparison` holds models side by side. `identify` is the verb that calls them in order; `design`, `honest`, `watch` and `why`
stand on it; `live` is the estimate while rows still come. It uses `rig`, `recordings`, `systems` and `core`; of the motor's
physics, `models` know the data sheets only.

Public: `identify`, `Result`, `compare`, `design`, `honest`, `validate`, `simulate`, `predict`, `residuals`, `reconcile`, `why`.
"""
