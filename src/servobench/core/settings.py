"""Settings: values from a file or from Python, checked on input, including units.

A field of a quantity type takes a number in SI units or a text with a unit: `frequency = 0.4` and `"0.4 Hz"` are the same.
A field that holds a member of a kind takes the member, or a table with its name and its settings.
"""

from __future__ import annotations

import ast
import inspect
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache
from itertools import pairwise
from textwrap import dedent
from typing import TYPE_CHECKING, Annotated, Any, Self, TypeAlias, get_args, get_origin

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    ModelWrapValidatorHandler,
    TypeAdapter,
    ValidationError,
    model_validator,
)
from pydantic.fields import FieldInfo
from pydantic_core import CoreSchema, ErrorDetails, InitErrorDetails, PydanticCustomError, core_schema

from servobench.core.errors import UnknownName, UsageError
from servobench.core.registry import Registry
from servobench.core.units import quantity

_WITH_UNITS = {"quantities": "with units"}
"""The context in which a quantity is written as a text. A context may also have another unit for a mark's, as {"V": "rad"}."""


@dataclass(frozen=True)
class In:
    """Marks a float as a finite quantity in the unit `si`; a text with another unit of the same quantity is converted."""

    si: str

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        writer = core_schema.plain_serializer_function_ser_schema(self._write, info_arg=True)
        number = core_schema.float_schema(allow_inf_nan=False)
        return core_schema.with_info_before_validator_function(self._read, number, serialization=writer)

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        return {"anyOf": [{"type": "number"}, {"type": "string"}], "unit": self.si}

    def _read(self, value: object, info: core_schema.ValidationInfo) -> float:
        return quantity(value, (info.context or {}).get(self.si, self.si))

    def _write(self, value: float, info: core_schema.SerializationInfo) -> float | str:
        context = info.context or {}
        if "quantities" not in context:
            return value
        return f"{value!r} {context.get(self.si, self.si)}".replace(".0 ", " ")


@dataclass(frozen=True)
class InBy:
    """Marks a float whose unit hangs on another setting, which stands before it: `units` pairs that one's values with units."""

    setting: str
    units: tuple[tuple[str, str], ...]

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.with_info_before_validator_function(self._read, handler(source))

    def unit(self, value: object) -> str:
        """Return the unit for a value of the other setting; that of the first where it has a mistake itself."""
        units = dict(self.units)
        return units.get(str(value), self.units[0][1])

    def _read(self, value: object, info: core_schema.ValidationInfo) -> float:
        return quantity(value, self.unit((info.data or {}).get(self.setting)))


@dataclass(frozen=True)
class MemberOf:
    """Marks a field that holds a member of the kind `registry`.

    It takes the member itself or a table, whose `type` is the member's name and whose other keys are its settings; it is written
    as such a table. Whatever the registry finds, a plug-in's members too, can stand here.
    """

    registry: Registry[Any]

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        writer = core_schema.plain_serializer_function_ser_schema(self._table, info_arg=True)
        return core_schema.with_info_plain_validator_function(self._read, serialization=writer)

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        return {
            "type": "object",
            "properties": {"type": {"enum": list(self.registry.names())}},
            "required": ["type"],
        }

    def _read(self, candidate: object, info: core_schema.ValidationInfo) -> object:
        if not isinstance(candidate, Mapping):
            return self._check_member(candidate)
        settings = {key: value for key, value in candidate.items() if key != "type"}
        return TypeAdapter(self._member_named(candidate.get("type"))).validate_python(
            settings, context=info.context
        )

    def _check_member(self, candidate: object) -> object:
        try:
            self.registry.name_of(candidate)
        except UsageError:
            known = ", ".join(self.registry.names())
            raise ValueError(
                f"{candidate!r} isn't a {self.registry.kind}; expected a table with a type, one of {known}"
            ) from None
        return candidate

    def _member_named(self, name: object) -> Any:
        known = ", ".join(self.registry.names())
        if name is None:
            sentence = f"is missing; expected the name of a {self.registry.kind}; known: {known}"
        elif not isinstance(name, str):
            sentence = f"{name!r} isn't the name of a {self.registry.kind}; known: {known}"
        else:
            try:
                return self.registry[name]
            except UnknownName as error:
                sentence = str(error)
        raise ValidationError.from_exception_data(
            self.registry.kind, [_problem("unknown_name", sentence, ("type",), name)]
        )

    def _table(self, member: Any, info: core_schema.SerializationInfo) -> dict[str, Any]:
        settings = TypeAdapter(type(member)).dump_python(
            member,
            mode="json" if info.mode_is_json() else "python",
            context=info.context,
            exclude_none=info.exclude_none,
        )
        return {"type": self.registry.name_of(member), **settings}


Voltage: TypeAlias = Annotated[float, In("V")]
Current: TypeAlias = Annotated[float, In("A")]
Time: TypeAlias = Annotated[float, In("s")]
Frequency: TypeAlias = Annotated[float, In("Hz")]
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
PositiveVoltage: TypeAlias = Annotated[Voltage, Field(gt=0)]
# A nanosecond to thirty years: wide enough for anything that turns, and its inverse and ratios are finite.
PositiveTime: TypeAlias = Annotated[Time, Field(gt=0), Field(ge=1e-9, le=1e9)]
PositiveFrequency: TypeAlias = Annotated[Frequency, Field(gt=0), Field(ge=1e-9, le=1e9)]


def unit_of(field: FieldInfo, settings: BaseModel | None = None) -> str:
    """Return the unit of a setting, or of the numbers that it holds several of; empty where it has none.

    Of a unit that hangs on another setting only `settings`, which the field belongs to, can tell which one it is.
    """
    for mark in (*field.metadata, *_marks(field.annotation)):
        if isinstance(mark, In):
            return mark.si
        if isinstance(mark, InBy) and settings is not None:
            return mark.unit(getattr(settings, mark.setting))
    return ""


def none_for(word: str) -> BeforeValidator:
    """Read a word as None: a file has no other way to write that there is no value."""
    return BeforeValidator(lambda value: None if isinstance(value, str) and value == word else value)


def problems_text(error: ValidationError) -> str:
    """Return what is wrong with settings, a sentence for each problem, after the name of the setting."""
    return "; ".join(
        ": ".join(filter(None, [".".join(map(str, each["loc"])), _in_words(each["msg"])]))
        for each in error.errors(include_url=False)
    )


def _in_words(problem: str) -> str:
    """A problem as pydantic tells it, in the manner of all other sentences."""
    sentence = problem.removeprefix("Value error, ")
    expected = sentence.removeprefix("Input should be ")
    return sentence if expected == sentence else f"expected {expected}"


@cache
def describe_fields(model: type[BaseModel]) -> None:
    """Give each field of a model that has no description the text below it in the source, its own or that of a base."""
    for kind in model.__mro__:
        for name, text in _texts_below(kind):
            field = model.__pydantic_fields__.get(name)
            if field is not None and field.description is None:
                field.description = text


def _texts_below(kind: type) -> Iterator[tuple[str, str]]:
    """The names with a type in a class, each with the text below it; none where there is no source."""
    if not (issubclass(kind, BaseModel) and kind is not BaseModel):
        return
    try:
        (definition,) = ast.parse(dedent(inspect.getsource(kind))).body
    except (OSError, TypeError):
        return
    for above, below in pairwise(getattr(definition, "body", ())):
        named = isinstance(above, ast.AnnAssign) and isinstance(above.target, ast.Name)
        if named and isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant):
            yield above.target.id, inspect.cleandoc(str(below.value.value))


if TYPE_CHECKING:
    _Model = BaseModel
else:

    class _TellsMistakes(type(BaseModel)):
        """Makes a call with wrong settings a sentence; what reads a file validates tables, and sees each problem by itself."""

        @property
        def model_fields(cls) -> dict[str, FieldInfo]:
            """The fields, each with the text below it: that is read when somebody asks, as most commands don't."""
            describe_fields(cls)
            return cls.__pydantic_fields__

        def __call__(cls, *positional: object, **settings: object) -> object:
            if positional:
                names = ", ".join(f"{name}=..." for name in cls.model_fields)
                raise UsageError(f"{cls.__name__} takes its settings by their names: {cls.__name__}({names})")
            try:
                return super().__call__(**settings)
            except ValidationError as error:
                raise UsageError(f"{cls.__name__}: {problems_text(error)}") from None

    class _Model(BaseModel, metaclass=_TellsMistakes):
        pass


class Settings(_Model):
    """Base of all settings: frozen, and strict about unknown names."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    @model_validator(mode="wrap")
    @classmethod
    def _name_known_keys(cls, data: Any, handler: ModelWrapValidatorHandler[Self]) -> Self:
        """For an unknown key, name the nearest and all known keys: a misspelling is the most likely mistake."""
        try:
            return handler(data)
        except ValidationError as error:
            problems = error.errors(include_url=False)
            if not any(problem["type"] == "extra_forbidden" for problem in problems):
                raise
            known = {field.alias or name: field for name, field in cls.model_fields.items()}
            retold = [_retold(problem, known) for problem in problems]
        raise ValidationError.from_exception_data(cls.__name__, retold)


def with_units(settings: Settings, units: Mapping[str, str] | None = None) -> dict[str, Any]:
    """Return settings as plain data that reads back the same: each quantity a text with its unit, no key where there is none.

    `units` has other units for those of the fields: {"V": "rad"} for the levels of a signal that a position follows.
    """
    return settings.model_dump(context={**_WITH_UNITS, **(units or {})}, exclude_none=True)


def _marks(annotation: Any) -> list[object]:
    """The markers of types inside a type, such as the unit of the numbers in a tuple."""
    own = list(getattr(annotation, "__metadata__", ()))
    inner = get_args(annotation)[:1] if get_origin(annotation) is Annotated else get_args(annotation)
    return own + [mark for each in inner for mark in _marks(each)]


def _retold(problem: ErrorDetails, known: Mapping[str, object]) -> InitErrorDetails:
    """The same problem, in our words where a key isn't known."""
    if problem["type"] != "extra_forbidden":
        return _problem(problem["type"], problem["msg"], problem["loc"], problem["input"])
    near = get_close_matches(str(problem["loc"][-1]), known, n=1)
    hint = f" (did you mean {near[0]!r}?)" if near else ""
    sentence = f"not known here{hint}; known: {', '.join(known)}"
    return _problem("not_known", sentence, problem["loc"], problem["input"])


def _problem(code: str, sentence: str, where: tuple[int | str, ...], value: object) -> InitErrorDetails:
    """One line of a validation error with a sentence of ours."""
    # The sentence goes in as a value, as it may hold braces itself.
    error = PydanticCustomError(code, "{sentence}", {"sentence": sentence})
    return InitErrorDetails(type=error, loc=where, input=value)
