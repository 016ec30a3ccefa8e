"""A transfer function in textbook notation, in MathML, which every browser displays without help."""

from __future__ import annotations

from html import escape

import numpy as np

from servobench.core.channels import Array
from servobench.core.parameter_names import parameter_symbol
from servobench.core.rounding import plain
from servobench.identification.estimators.base import Fit
from servobench.identification.result import Result
from servobench.identification.uncertainty.bands import coefficient_halves
from servobench.systems.transfer_function import TransferFunction

_MOST_DIGITS = 5  # of a coefficient; the table of parameters has them all


def transfer_function_math(result: Result) -> str:
    """Return G(s), from input to speed, as `<math>` elements: symbols, and what is known in numbers; empty without a fit."""
    fit = result.fit
    if fit is None:
        return ""
    system, unknown = fit.model.transfer_function("speed"), result.unknown_symbols
    unit = f'<mspace width="0.6em"></mspace><mtext>{escape(system.unit)}</mtext>'
    whole, first_order = _row(_name("G"), _brackets(_name("s"))), _is_first_order(fit, system)
    numbers = _in_numbers(system, coefficient_halves(fit), unknown if first_order else unknown - {"τ"})
    if not first_order:
        return _math(whole, _sign("="), numbers, unit)
    symbols = _row(_fraction(_name("K"), _lag()), _delay_factor(_row(_sign("−"), _name("d"), _name("s"))))
    if unknown >= {"K", "τ"}:
        return _math(whole, _sign("="), symbols, unit)
    # Two pieces, so that a narrow page can set them below each other.
    return _math(whole, _sign("="), symbols) + _math(_sign("="), numbers, unit)


def symbol(name: str) -> str:
    """Return the symbol of a parameter as HTML; empty for one that has none."""
    base, _, index = parameter_symbol(name).partition("_")
    return f"<i>{base}</i>{f'<sub>{index}</sub>' if index else ''}" if base else ""


def _is_first_order(fit: Fit, system: TransferFunction) -> bool:
    names = set(fit.model.names)
    return (
        {"gain", "time_constant", "delay"} <= names
        and len(system.denominator) == 2
        and len(system.numerator) == 1
    )


def _lag() -> str:
    return _row(_name("τ"), _name("s"), _sign("+"), _number("1"))


def _in_numbers(system: TransferFunction, halves: Array, unknown: frozenset[str]) -> str:
    upper, lower = len(system.numerator), len(system.denominator)
    whole = "K" not in unknown or upper > 1
    numerator = _polynomial(system.numerator, halves[:upper]) if whole else _name("K")
    denominator = _lag() if "τ" in unknown else _polynomial(system.denominator, halves[upper : upper + lower])
    fraction = _fraction(numerator, denominator)
    if system.delay == 0 or "d" in unknown:
        return fraction
    text = _coefficient(abs(system.delay), halves[-1])
    minus = (_sign("−"),) if system.delay > 0 else ()
    exponent = _row(*minus, _number(text), _thin_space(), _name("s"))
    return _row(fraction, _delay_factor(exponent))


def _polynomial(coefficients: tuple[float, ...], halves: Array) -> str:
    order = len(coefficients) - 1
    parts: list[str] = []
    for power, value, half in zip(range(order, -1, -1), coefficients, halves, strict=True):
        if value == 0 and order > 0:
            continue
        if parts or value < 0:
            parts.append(_sign("−" if value < 0 else "+"))
        text = _coefficient(abs(value), half)
        if text != "1" or power == 0:
            parts.append(_number(text))
            if power:
                parts.append(_thin_space())
        if power == 1:
            parts.append(_name("s"))
        elif power > 1:
            parts.append(f"<msup>{_name('s')}{_number(str(power))}</msup>")
    return _row(*(parts or [_number("0")]))


def _coefficient(value: float, half: float) -> str:
    """A coefficient with as many digits as are known of it, two at the least."""
    if not (np.isfinite(half) and half > 0 and value > 0):
        return plain(value, _MOST_DIGITS)
    known = int(np.floor(np.log10(value))) - int(np.floor(np.log10(half))) + 2
    return plain(value, min(max(known, 2), _MOST_DIGITS))


def _math(*parts: str) -> str:
    return f'<math display="inline">{"".join(parts)}</math>'


def _row(*parts: str) -> str:
    return f"<mrow>{''.join(parts)}</mrow>"


def _name(text: str) -> str:
    return f"<mi>{escape(text)}</mi>"


def _number(text: str) -> str:
    return f"<mn>{escape(text)}</mn>"


def _sign(text: str) -> str:
    return f"<mo>{escape(text)}</mo>"


def _thin_space() -> str:
    return '<mspace width="0.17em"></mspace>'


def _brackets(inner: str) -> str:
    return f"{_sign('(')}{inner}{_sign(')')}"


def _fraction(above: str, below: str) -> str:
    return f'<mstyle displaystyle="true"><mfrac>{above}{below}</mfrac></mstyle>'


def _delay_factor(exponent: str) -> str:
    return f"{_thin_space()}<msup>{_name('e')}{exponent}</msup>"
