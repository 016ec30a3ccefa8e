"""The sources of compiled code: the file of its module, those of the modules that it calls, and the constants that it uses."""

from __future__ import annotations

import hashlib
import sys
from functools import cache
from pathlib import Path
from types import ModuleType


@cache
def source_stamp(module: str) -> str:
    """Return a checksum of all that a kernel in that module is compiled from, within its own package and this one.

    Empty where the module isn't a file's, as in a notebook. Numba looks at the file of the kernel alone, and would go on with
    what it has where a kernel that this one calls was changed.
    """
    sources: dict[str, bytes] = {}
    if not getattr(sys.modules.get(module), "__file__", None):
        return ""
    _gather(sys.modules[module], {module.partition(".")[0], __name__.partition(".")[0]}, sources)
    digest = hashlib.sha256()
    for name in sorted(sources):
        digest.update(name.encode() + b"\0" + sources[name] + b"\0")
    return digest.hexdigest()


def _gather(module: ModuleType, packages: set[str], sources: dict[str, bytes]) -> None:
    """Add the source of a module and its numbers, then those of the modules that its names come from."""
    numbers = sorted((name, value) for name, value in vars(module).items() if isinstance(value, int | float))
    sources[module.__name__] = _source(module) + repr(numbers).encode()
    for value in list(vars(module).values()):
        origin = value if isinstance(value, ModuleType) else sys.modules.get(_home(value))
        if origin is None or origin.__name__.partition(".")[0] not in packages or origin.__name__ in sources:
            continue
        _gather(origin, packages, sources)


def _home(value: object) -> str:
    """The name of the module that a function comes from; of a class, whose methods no kernel calls, none."""
    home = None if isinstance(value, type) else getattr(value, "__module__", None)
    return home if isinstance(home, str) else ""


def _source(module: ModuleType) -> bytes:
    """The source of a module as it stands on the disk; nothing where it comes from elsewhere."""
    try:
        return Path(module.__file__ or "").read_bytes()
    except OSError:
        return b""
