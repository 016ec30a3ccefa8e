"""The modules that programs import: those of the hardware, and the rest of the package, which can be imported but not used."""

from __future__ import annotations

import sys
from types import ModuleType
from typing import Any

from servobench.compat.quanser import enumerations, errors
from servobench.compat.quanser.card import Version
from servobench.compat.quanser.enumerations import ENDLESS, MAX_STRING_LENGTH
from servobench.compat.quanser.hil import HIL

_NAMES = {name: value for name, value in vars(enumerations).items() if isinstance(value, type)}
_ERRORS = ("communications.StreamError", "devices.DeviceError", "multimedia.MediaError")


class Timeout:
    """A time to wait: seconds and nanoseconds, from now on or as a point in time."""

    def __init__(self, seconds: int = 0, nanoseconds: int = 0, is_absolute: bool = False) -> None:
        self.seconds, self.nanoseconds, self.is_absolute = seconds, nanoseconds, is_absolute


class Absent(type):
    """The type of what can be imported but not used: its attributes are of the same type, and a call raises `GenericError`."""

    def __getattr__(cls, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        return absent(f"{cls.__module__}.{cls.__name__}", name)

    def __call__(cls, *arguments: Any, **named: Any) -> Any:
        """Raise `GenericError`: there is nothing behind the name."""
        raise errors.GenericError(
            -int(errors.Code.NOT_SUPPORTED),
            f"{cls.__module__}.{cls.__name__}: the stand-in has the hardware interface of a QUBE-Servo alone; "
            "cameras, streams and other devices need Quanser's own software.",
        )


def absent(module: str, name: str) -> Any:
    """Return what stands in for something of a module that can't be used."""
    return Absent(name, (), {"__module__": module})


class AbsentModule(ModuleType):
    """A module whose every name can be imported, and none used."""

    __path__: list[str] = []  # noqa: RUF012 - what makes a module a package

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return absent(self.__name__, name)


def _module(name: str, contents: dict[str, Any]) -> ModuleType:
    module = ModuleType(name, "A stand-in of servobench's; not Quanser's.")
    module.__path__ = []
    vars(module).update(contents)
    return module


def modules() -> dict[str, ModuleType]:
    """Return the modules of the stand-in by their names."""
    common = {"GenericError": errors.GenericError, "Timeout": Timeout}
    types = {"Version": Version, "MAX_STRING_LENGTH": MAX_STRING_LENGTH}
    hardware = {**_NAMES, **types, "HIL": HIL, "HILError": errors.HILError}
    made = {
        "quanser": _module("quanser", {"__version__": "stand-in"}),
        "quanser.common": _module("quanser.common", common),
        "quanser.common.exceptions": _module("quanser.common.exceptions", common),
        "quanser.hardware": _module("quanser.hardware", hardware),
        "quanser.hardware.enumerations": _module("quanser.hardware.enumerations", dict(_NAMES)),
        "quanser.hardware.exceptions": _module("quanser.hardware.exceptions", {"HILError": errors.HILError}),
        "quanser.hardware.types": _module("quanser.hardware.types", types),
        "quanser.hardware.hil": _module("quanser.hardware.hil", {"HIL": HIL}),
    }
    for error in _ERRORS:
        package, _, name = error.partition(".")
        made.update(_absent_package(f"quanser.{package}", name))
    made["quanser.communications"].Timeout = Timeout  # type: ignore[attr-defined]
    for name in ("image_processing", "robotics"):
        made[f"quanser.{name}"] = AbsentModule(f"quanser.{name}")
    _link(made)
    if sys.platform != "win32":
        # An older version of Quanser's pal takes the number for an endless task from there.
        made["asyncio.windows_events"] = _module("asyncio.windows_events", {"INFINITE": ENDLESS})
    return made


def _absent_package(package: str, error: str) -> dict[str, ModuleType]:
    """A package that can be imported: its error is one, as programs catch it."""
    kind = type(error, (errors.GenericError,), {"__module__": f"{package}.exceptions"})
    made: dict[str, ModuleType] = {
        name: AbsentModule(name)
        for name in (package, *(f"{package}.{part}" for part in ("enumerations", "types")))
    }
    made[f"{package}.exceptions"] = _module(f"{package}.exceptions", {error: kind})
    setattr(made[package], error, kind)
    return made


def _link(made: dict[str, ModuleType]) -> None:
    """Make each module an attribute of the one that it belongs to, as an import does."""
    for name, module in made.items():
        package, _, last = name.rpartition(".")
        if package:
            setattr(made[package], last, module)


def replace_modules() -> dict[str, ModuleType | None]:
    """Put the stand-in's modules in place, and return those that were there, None for those that weren't."""
    made = modules()
    real = {name for name in sys.modules if name == "quanser" or name.startswith("quanser.")}
    originals = {name: sys.modules.get(name) for name in (*made, *real)}
    for name in real:
        del sys.modules[name]
    sys.modules.update(made)
    return originals


def restore_modules(previous: dict[str, ModuleType | None]) -> None:
    """Put the modules back that were there."""
    for name, module in previous.items():
        if module is None:
            sys.modules.pop(name, None)
        else:
            sys.modules[name] = module
