"""A servo with its own position controller, driven by a goal: the structure, its exact response with friction, and guesses."""

from servobench.identification.models.position_loop.structure import PositionLoop as PositionLoop
