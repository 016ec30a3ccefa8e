"""The value of --device: a device's name, an address behind a colon if it has one, and settings."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from servobench.rig.experiment import DeviceChoice


def device_choice(text: str, in_file: DeviceChoice, where: str, option: str = "--device ") -> DeviceChoice:
    """Return the device that a text such as `rig:/dev/ttyUSB0 supply=9V` names, with the faults of the one in the file.

    Where it is the device in the file the settings in the file hold, too, unless the text says others. `where` says where else
    settings can be given, with {} in place of the name; `said` is what stands before the text on the command line. Raises
    `UsageError` for a text that names no device, or leaves out a setting that the device needs.
    """
    from servobench.core.errors import UsageError
    from servobench.rig.devices.base import missing_settings

    name, text_settings = _read(text, option)
    settings: Mapping[str, Any] = (
        {**in_file.settings, **text_settings} if name == in_file.name else text_settings
    )
    if missing := missing_settings(name, settings):
        lines = [f"{option}{text}: {each}" for each in missing]
        raise UsageError(
            "\n".join([*lines, f"give the settings after the name, as key=value, or {where.format(name)}"])
        )
    return in_file.model_copy(update={"name": name, "settings": settings})


def _read(text: str, option: str) -> tuple[str, dict[str, Any]]:
    """The name and the settings in a text."""
    from servobench.core.errors import UsageError
    from servobench.rig.devices.base import DEVICES

    try:
        words = shlex.split(text)
    except ValueError:
        words = []
    if not words:
        raise UsageError(
            f"{option}{text!r} can't be read; expected a name and settings: rig:/dev/ttyUSB0 supply=9V"
        )
    name, colon, address = words[0].partition(":")
    settings: dict[str, Any] = {}
    if colon:
        setting = getattr(DEVICES[name], "address", None)
        if setting is None or not address:
            raise UsageError(
                f"{option}{words[0]!r}: {'nothing follows' if setting else f'the device {name} takes nothing after'} the colon; "
                f"expected {option}{name}{':' + setting.upper() if setting else ''}"
            )
        settings[setting] = address
    for word in words[1:]:
        key, sign, value = word.partition("=")
        if not (key and sign and value) or key in settings:
            raise UsageError(
                f"{option}{text!r}: {word!r} isn't a setting, or occurs twice; expected key=value, as in supply=9V"
            )
        settings[key] = _value(value)
    return name, settings


def _value(text: str) -> Any:
    """A number, true or false where the text is one, as in a file, otherwise the text."""
    import tomllib

    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text
