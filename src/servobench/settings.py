"""Settings: values that come from a file or from Python, checked at the door, units included.

A field of a quantity type takes a number in SI units or a text with a unit: `frequency = 0.4` and `"0.4 Hz"` are the same.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, TypeAlias

from pydantic import BaseModel, ConfigDict, GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic_core import CoreSchema, core_schema

from servobench.units import quantity


@dataclass(frozen=True)
class In:
    """Marks a float as a finite quantity in the unit `si`; a text with another unit of the same quantity is converted."""

    si: str

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_before_validator_function(self._read, core_schema.float_schema(allow_inf_nan=False))

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {"anyOf": [{"type": "number"}, {"type": "string"}], "unit": self.si}

    def _read(self, given: object) -> object:
        return quantity(given, self.si) if isinstance(given, str) else given


Voltage: TypeAlias = Annotated[float, In("V")]
Current: TypeAlias = Annotated[float, In("A")]
Time: TypeAlias = Annotated[float, In("s")]
Frequency: TypeAlias = Annotated[float, In("Hz")]
AngularFrequency: TypeAlias = Annotated[float, In("rad/s")]
Speed: TypeAlias = Annotated[float, In("rad/s")]
Angle: TypeAlias = Annotated[float, In("rad")]
Resistance: TypeAlias = Annotated[float, In("ohm")]
Inductance: TypeAlias = Annotated[float, In("H")]
MotorConstant: TypeAlias = Annotated[float, In("V·s/rad")]
Inertia: TypeAlias = Annotated[float, In("kg·m²")]
Damping: TypeAlias = Annotated[float, In("N·m·s/rad")]
Torque: TypeAlias = Annotated[float, In("N·m")]
TorqueNoise: TypeAlias = Annotated[float, In("N·m/√Hz")]
CountsPerRev: TypeAlias = Annotated[float, In("counts/rev")]
Slew: TypeAlias = Annotated[float, In("V/s")]


class Settings(BaseModel):
    """What all settings are: frozen, and without a place for a misspelt name."""

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)
