"""Motor parameters given on the command line: `resistance=8.4`, `resistance=8.4±0.4 Ω`."""

from __future__ import annotations

from collections.abc import Sequence


def parse_parameters(texts: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Return each stated parameter as (value, standard deviation) in SI units, 0 for one without a standard deviation.

    Each text is NAME=VALUE or NAME=VALUE±SD (or +-SD), with a unit at its end where that isn't the SI unit. Raises `UsageError`
    for another text or for a value that no motor has, and `UnknownName` for a name that is no parameter of a motor.
    """
    from servobench.core.errors import UnitError, UnknownName, UsageError
    from servobench.core.units import quantity
    from servobench.identification.motor_parameters.observation import UNITS, from_values

    parameters: dict[str, tuple[float, float]] = {}
    for text in texts:
        name, _, value_text = (part.strip() for part in text.partition("="))
        if not value_text:
            raise UsageError(
                f"--known {text}: expected NAME=VALUE or NAME=VALUE±SD, such as resistance=8.4±0.4"
            )
        if name not in UNITS:
            raise UnknownName("parameter of a motor", name, UNITS)
        value, _, sd = (part.strip() for part in value_text.replace("+-", "±").partition("±"))
        unit = sd.lstrip("0123456789.eE+-").strip()
        try:
            pair = quantity(f"{value} {unit}", UNITS[name]), quantity(sd, UNITS[name]) if sd else 0.0
        except UnitError as error:
            raise UsageError(f"--known {text}: {error}") from None
        if name in parameters:
            raise UsageError(f"--known {text}: {name} was given before; give it once")
        parameters[name] = pair
    from_values(parameters)
    return parameters
