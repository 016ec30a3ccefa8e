"""The expression of a blank's rule: arithmetic over named facts, and how far it is known."""

from __future__ import annotations

import ast
import math
import operator
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from servobench.core.errors import UnknownName, UsageError

_LONGEST = 200  # characters; no rule needs more
_HIGHEST = 64  # exponent; a power of it still is a number
_STEP = 1e-6  # of a value, for the difference that its slope is taken from
_CONSTANTS = {"pi": math.pi}
_FUNCTIONS: dict[str, Callable[[float], float]] = {
    "sqrt": math.sqrt,
    "exp": math.exp,
    "log": math.log,
    "abs": abs,
}
_OPERATORS: dict[type[ast.operator], Callable[[float, float], float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
}


@dataclass(frozen=True, kw_only=True)
class Fact:
    """Something that is known: a value, and half of its 95 % interval (0 where it is exact), in SI units."""

    value: float
    half: float = 0.0


@dataclass(frozen=True)
class Expression:
    """Arithmetic over facts by name, such as `2 * pi / counts_per_rev`: + - * / **, brackets, sqrt, exp, log, abs and pi.

    Raises `UsageError` for a text that is anything else.
    """

    text: str

    def __post_init__(self) -> None:
        _check(self._tree(), self.text)

    @property
    def names(self) -> tuple[str, ...]:
        """The facts that are requested, sorted."""
        nodes = ast.walk(self._tree())
        called = {*_CONSTANTS, *_FUNCTIONS}
        return tuple(sorted({node.id for node in nodes if isinstance(node, ast.Name)} - called))

    def evaluate(self, facts: Mapping[str, Fact]) -> Fact:
        """Return the value, and by how much it may be off: the sum of what each fact's interval moves it by, to first order.

        That sum is the largest that any correlation between the facts allows. Raises `UnknownName` for a fact that isn't there,
        and `UsageError` where there is no finite value.
        """
        missing = [name for name in self.names if name not in facts]
        if missing:
            raise UnknownName("fact", missing[0], facts)
        values = {name: facts[name].value for name in self.names}
        value = self._at(values)
        half = 0.0
        for name in self.names:
            known = facts[name]
            if known.half:
                step = _STEP * (abs(known.value) or 1.0)
                slope = (self._at({**values, name: known.value + step}) - value) / step
                half += abs(slope) * known.half if slope else 0.0
        return Fact(value=value, half=half)

    def _at(self, values: Mapping[str, float]) -> float:
        try:
            value = _value(self._tree(), values)
        except (ArithmeticError, ValueError) as error:
            raise UsageError(f"`{self.text}` has no value{_with(values)}: {_why(error)}") from None
        if isinstance(value, complex) or not math.isfinite(value):
            raise UsageError(f"`{self.text}` has no finite value{_with(values)}")
        return value

    def _tree(self) -> ast.expr:
        if len(self.text) > _LONGEST:
            raise UsageError(
                f"an expression of {len(self.text)} characters is too long; expected {_LONGEST} at most"
            )
        try:
            return ast.parse(self.text.strip(), mode="eval").body
        except (SyntaxError, ValueError, RecursionError, MemoryError):
            raise UsageError(f"`{self.text}` is no expression; {_expectation(self.text)}") from None


def _with(values: Mapping[str, float]) -> str:
    values_text = ", ".join(f"{name} = {value:.6g}" for name, value in values.items())
    return f" with {values_text}" if values_text else ""


def _why(error: ArithmeticError | ValueError) -> str:
    if isinstance(error, ZeroDivisionError):
        return "it divides by zero"
    if isinstance(error, ValueError):
        return "it takes a root or a logarithm of a number that has none"
    return str(error) if len(error.args) == 1 else "a number in it is too large"


# What is written otherwise elsewhere, and how it is written here.
_OTHERWISE = (
    (re.compile(r"\^"), "a power is written as **"),
    (re.compile(r"\bln\b"), "the natural logarithm is called log"),
    (re.compile(r"\d,\d"), "a number has a decimal point"),
    (re.compile(r"[×·÷]"), "* multiplies and / divides"),
    (re.compile(r"[π√²³]"), "pi, sqrt() and ** 2 stand for π, √ and ²"),
    (re.compile(r"[\w)]\s+[\w(]"), "a product has a *"),
)


def _expectation(text: str) -> str:
    hints = [hint for pattern, hint in _OTHERWISE if pattern.search(text)]
    return "; ".join([_EXPECTED, *hints])


_EXPECTED = "expected numbers, names of facts, + - * / **, brackets, sqrt, exp, log, abs and pi"


def _check(node: ast.expr, text: str) -> None:
    """Raise `UsageError` for anything but arithmetic: a file that a lecturer got from somewhere must not run code."""
    match node:
        case ast.Constant(value=bool()):
            pass
        case ast.Constant(value=int() | float()) | ast.Name():
            return
        case ast.UnaryOp(op=ast.USub() | ast.UAdd(), operand=inner):
            return _check(inner, text)
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATORS:
            _check(left, text)
            return _check(right, text)
        case ast.Call(func=ast.Name(id=name), args=[inner], keywords=[]) if name in _FUNCTIONS:
            return _check(inner, text)
    raise UsageError(f"`{ast.unparse(node)}` in `{text}` can't be computed; {_expectation(text)}")


def _value(node: ast.expr, values: Mapping[str, float]) -> float:
    match node:
        case ast.Constant(value=number):
            return float(number)  # type: ignore[arg-type]
        case ast.Name(id=name):
            return _CONSTANTS[name] if name in _CONSTANTS else values[name]
        case ast.UnaryOp(op=op, operand=inner):
            return -_value(inner, values) if isinstance(op, ast.USub) else _value(inner, values)
        case ast.BinOp(left=left, op=op, right=right):
            a, b = _value(left, values), _value(right, values)
            if isinstance(op, ast.Pow) and abs(b) > _HIGHEST:
                raise OverflowError(f"a power of {b:g} is too high")
            return _OPERATORS[type(op)](a, b)
        case ast.Call(func=ast.Name(id=name), args=[inner]):
            return _FUNCTIONS[name](_value(inner, values))
    raise UsageError(f"`{ast.unparse(node)}` can't be computed; {_EXPECTED}")
