"""The facts of an exercise by name, which rules and studies may ask for: what its stand knows."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from servobench.lab.exercise import Exercise
from servobench.lab.expression import Fact
from servobench.lab.stand import stand_of, stand_on_the_twin

if TYPE_CHECKING:
    from servobench.recording.recording import Recording


def facts_of(exercise: Exercise, recording: Recording) -> Mapping[str, Fact]:
    """Return the facts of a recording that somebody made for an exercise, looked at through the exercise's chain.

    Raises `UsageError` for a recording that doesn't say what device it is of.
    """
    return stand_of(exercise, recording).facts


def facts_on_the_twin(exercise: Exercise) -> Mapping[str, Fact]:
    """Return the facts of an exercise's experiment on the simulated motor, in virtual time; it is run when they are asked for."""
    return stand_on_the_twin(exercise).facts
