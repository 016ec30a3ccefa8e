"""The errors that servobench raises, and the exit status each one ends a command with.

The tree::

    ServobenchError                      1   never raised itself
    ├── UsageError (ValueError)          2   the user's mistake, or a file that can't be read
    │   ├── UnknownName (LookupError)        no member of that name; lists the known ones
    │   ├── UnitError                        not a unit, or a unit of the wrong quantity
    │   ├── ExperimentError                  an experiment file with mistakes, all of them at once
    │   ├── FormatError                      a file that isn't what it should be
    │   └── MissingInformation               a file that doesn't say enough; says what to add
    ├── NotIdentifiable (ValueError)     3   the data can't support the model that was requested
    ├── SimulationDiverged (ArithmeticError) 2   a solver's step is too long for the motor
    ├── DeviceError (OSError)            4   the device failed
    │   └── DeviceLost                       in the middle of a run; carries the recording so far (`rig.lost_device`)
    │       └── DeviceSilent                     a call of it didn't return; what is known of the motor stands in the message
    └── StorageError (OSError)           5   nothing more could be written

Every message says which thing, which value, what was expected, and what to do next.
An outcome that is no mistake (a stop, a refused identification) is a result, not an error.
"""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches
from typing import TYPE_CHECKING, ClassVar

if TYPE_CHECKING:
    pass


class ServobenchError(Exception):
    """Base of all errors of this package; `exit_status` is the status that a command ends with."""

    exit_status: ClassVar[int] = 1


class UsageError(ServobenchError, ValueError):
    """The user asked for something that can't be; the message says what can."""

    exit_status = 2


class UnknownName(UsageError, LookupError):
    """No member of a kind has that name; the message lists the known names and the nearest one, and ends as given."""

    def __init__(self, kind: str, name: object, known: Iterable[str], ending: str = "") -> None:
        names = sorted(known)
        near = get_close_matches(str(name), names, n=1)
        hint = f" (did you mean {near[0]!r}?)" if near else ""
        known_names = f"known: {', '.join(names)}" if names else "there are none"
        super().__init__(f"no {kind} called {name!r}{hint}; {known_names}{ending}")


class UnitError(UsageError):
    """A text that is no unit, or a unit of another quantity than the one expected."""


class ExperimentError(UsageError):
    """An experiment that can't be run as it's written; the message has a line for each mistake."""


class FormatError(UsageError):
    """A file that isn't of the format it should be, or is damaged beyond reading."""


class MissingInformation(UsageError):
    """A recording doesn't say enough; `missing` has one sentence for each thing to add."""

    def __init__(self, source: str, missing: Iterable[str]) -> None:
        self.missing = tuple(missing)
        super().__init__("\n".join([f"{source}: information is missing to identify this:", *self.missing]))


class NotIdentifiable(ServobenchError, ValueError):
    """The data can't support what was requested; the message says which and what to measure instead."""

    exit_status = 3


class SimulationDiverged(ServobenchError, ArithmeticError):
    """A solver's step is too long for the motor's fastest time constant; the message names both."""

    exit_status = 2


class DeviceError(ServobenchError, OSError):
    """A device that can't be opened, or failed."""

    exit_status = 4


class StorageError(ServobenchError, OSError):
    """Nothing more could be written; what was written before is kept."""

    exit_status = 5
