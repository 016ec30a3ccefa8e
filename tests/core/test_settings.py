"""Settings: quantities at the door, unknown keys, members of a kind, and writing back."""

from typing import Annotated, Protocol

import pytest
from pydantic import TypeAdapter, ValidationError

from servobench.core.registry import Registry
from servobench.core.settings import MemberOf, PositiveTime, Settings, Time, Voltage, with_units


class Inner(Settings):
    level: Voltage = 1.0


class Example(Settings):
    voltage: Voltage = 2.0
    delay: PositiveTime | None = None
    levels: tuple[Voltage, ...] = ()
    inner: Inner = Inner()
    count: int = 3


def message(given: dict[str, object]) -> str:
    with pytest.raises(ValidationError) as caught:
        Example.model_validate(given)
    return "; ".join(f"{'.'.join(map(str, e['loc']))}: {e['msg']}" for e in caught.value.errors())


def test_a_quantity_takes_a_number_in_si_or_a_text_with_its_unit() -> None:
    given = {"voltage": "1500 mV", "delay": "3 ms", "levels": [1, "2 V", "0.1 kV"], "inner": {"level": -1}}

    example = Example.model_validate(given)

    assert (example.voltage, example.delay, example.levels, example.inner.level) == (
        1.5,
        0.003,
        (1.0, 2.0, 100.0),
        -1.0,
    )
    assert isinstance(example.inner.level, float)


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({"voltage": "2 A"}, "voltage: Value error, '2 A' is a current; expected something in V"),
        ({"voltage": True}, "voltage: Value error, True isn't a number with a unit"),
        ({"voltage": None}, "voltage: Value error, None isn't a number with a unit"),
        ({"voltage": float("nan")}, "voltage: Input should be a finite number"),
        ({"delay": "-1 ms"}, "delay: Input should be greater than 0"),
        ({"delay": float("inf")}, "delay: Input should be a finite number"),
        ({"levels": [1, "2 s"]}, "levels.1: Value error, '2 s' is a time"),
    ],
)
def test_what_is_no_such_quantity_is_refused_where_it_stands(given: dict[str, object], expected: str) -> None:
    assert expected in message(given)


def test_an_unknown_key_is_reported_with_the_nearest_and_all_known_ones_beside_all_other_mistakes() -> None:
    said = message({"voltag": 1, "count": "{many}", "inner": {"levle": "{0}"}})

    assert (
        "voltag: not known here (did you mean 'voltage'?); known: voltage, delay, levels, inner, count"
        in said
    )
    assert "inner.levle: not known here (did you mean 'level'?); known: level" in said
    assert "count: Input should be a valid integer" in said


def test_settings_are_frozen_and_equal_by_value() -> None:
    example = Example(voltage=1)

    with pytest.raises(ValidationError, match="frozen"):
        example.voltage = 2.0  # type: ignore[misc]
    assert example == Example(voltage=1.0)
    assert hash(example) == hash(Example(voltage=1.0))


def test_settings_written_with_units_read_back_the_same() -> None:
    example = Example(voltage=0.1 + 0.2, delay=1e-7, levels=(1.0, 1e22, -5e-324), count=4)

    written = with_units(example)

    assert written["voltage"] == "0.30000000000000004 V"
    assert written["levels"] == ("1 V", "1e+22 V", "-5e-324 V")
    assert Example.model_validate(written) == example
    assert "delay" not in with_units(Example())
    assert example.model_dump()["delay"] == 1e-7


class Shape(Protocol):
    size: float


SHAPES: Registry[type[Shape]] = Registry("shape", "servobench.systems.signals", "servobench.signals")
AnyShape = Annotated[Shape, MemberOf(SHAPES)]


@SHAPES.member("disc")
class Disc(Settings):
    size: Time = 1.0


@pytest.fixture(autouse=True)
def no_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(SHAPES, "_complete", True)


def test_a_member_is_given_as_itself_or_as_a_table_with_its_name() -> None:
    shapes: TypeAdapter[Shape] = TypeAdapter(AnyShape)

    assert shapes.validate_python({"type": "disc", "size": "2 s"}) == Disc(size=2)
    assert shapes.validate_python(Disc(size=2)) == Disc(size=2)
    assert shapes.dump_python(Disc(size=2)) == {"type": "disc", "size": 2.0}
    assert shapes.json_schema()["properties"]["type"]["enum"] == ["disc"]


@pytest.mark.parametrize(
    ("given", "where", "expected"),
    [
        ({"type": "dics"}, ("type",), "no shape called 'dics' (did you mean 'disc'?); known: disc"),
        ({"type": 3}, ("type",), "3 isn't the name of a shape; known: disc"),
        ({}, ("type",), "is missing; expected the name of a shape; known: disc"),
        ({"type": "disc", "size": "2 V"}, ("size",), "'2 V' is a voltage"),
        ("disc", (), "'disc' isn't a shape; expected a table with a type, one of disc"),
        (Inner(), (), "isn't a shape; expected a table with a type"),
    ],
)
def test_what_is_no_member_is_reported_where_it_stands(
    given: object, where: tuple[str, ...], expected: str
) -> None:
    with pytest.raises(ValidationError) as caught:
        TypeAdapter(AnyShape).validate_python(given)
    (problem,) = caught.value.errors()
    assert problem["loc"] == where
    assert expected in problem["msg"]
