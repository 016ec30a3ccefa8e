"""The exercises: texts with blanks, experiments to fill them from, and the check of what was filled in.

`exercise` is the noun, `exercise_file` reads one, `studies` is the kind of what an exercise works out and shows; `check` and
`assessment` judge answers. It uses `report`, `identification`, `rig`, `recordings`, `systems` and `core`.
"""
