"""The exercises: texts with blanks, experiments that give the answers, and the check of the answers.

`exercise` is the noun, `exercise_file` reads one, `studies` is the kind of calculation that an exercise shows; `check` and
`assessment` judge answers. It uses `report`, `identification`, `rig`, `recordings`, `systems` and `core`.
"""
