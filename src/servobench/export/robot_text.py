"""Robot code: the constants of a mechanism as lines of a language, each with its interval in a comment."""

from __future__ import annotations

import keyword
import re
from collections.abc import Callable

from servobench.core.errors import UsageError
from servobench.export.robot import RobotConstants, interval_text, number_text

_ORDER = {
    "SimpleMotor": ("kS", "kV", "kA"),
    "Elevator": ("kS", "kG", "kV", "kA"),
    "Arm": ("kS", "kCos", "kV", "kA"),
}
_ASCII = str.maketrans({"·": " ", "²": "^2", "±": "+-", "–": "-", "−": "-"})
# Words that Java and C++ don't take for a name, beside those of Python.
_RESERVED = frozenset({
    "auto", "case", "char", "const", "default", "delete", "do", "double", "enum", "export", "final", "float", "goto", "int",
    "long", "namespace", "new", "package", "private", "protected", "public", "short", "signed", "static", "struct", "super",
    "switch", "template", "this", "throw", "typedef", "union", "unsigned", "using", "virtual", "void", "volatile",
})  # fmt: skip


def header_lines(constants: RobotConstants) -> list[str]:
    """Return what stands above the constants, without the marks of a comment: where they come from, the law, what to know."""
    load = {"Elevator": " + kG", "Arm": " + kCos cos(angle)"}.get(constants.mechanism, "")
    u = constants.unit
    lines = [
        *constants.comment,
        f"V = kS sgn(v) + kV v + kA a{load}, with v in {u}/s and a in {u}/s^2.",
        *constants.notes,
    ]
    return [line.translate(_ASCII) for line in lines]


def constant_lines(constants: RobotConstants, line: Callable[[str, str, str], str]) -> list[str]:
    """Return a line for each constant, `line(name, number, comment)` of a language, the loops' gains behind the feedforward.

    A feedforward constant that the model hasn't is 0, so that the call which takes it compiles.
    """
    lines = []
    for name in _ORDER[constants.mechanism]:
        e = constants.feedforward.get(name)
        if e is None:
            lines.append(line(name, "0.0", "left out: see above"))
        else:
            lines.append(
                line(
                    name,
                    _literal(e.value, number_text(e.value, e)),
                    f"{e.unit}, 95 %: {interval_text(e)}".translate(_ASCII),
                )
            )
    gains, u = constants.gains, constants.unit
    return [
        *lines,
        line("kVelocityP", _literal(gains.speed_gain), f"V s/{u}, beside the feedforward"),
        line("kVelocityI", _literal(gains.speed_integral), f"V/{u}"),
        line("kPositionP", _literal(gains.position_gain), f"V/{u}"),
        line("kPositionD", _literal(gains.position_derivative), f"V s/{u}"),
    ]


def feedback_text(constants: RobotConstants) -> str:
    """Return for which loop the gains are."""
    late = (
        f" and a measurement that is {constants.measurement_delay:g} s late"
        if constants.measurement_delay
        else ""
    )
    return f"Feedback for a loop every {constants.period:g} s{late}; closed loop {constants.gains.closed_loop:.3g} s."


def feedforward_arguments(constants: RobotConstants) -> str:
    """Return the arguments of WPILib's feedforward for the mechanism, in their order."""
    return ", ".join(_ORDER[constants.mechanism])


def check_name(stem: str, language: str) -> None:
    """Raise `UsageError` where a file's name is no name in the language."""
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,60}", stem) or keyword.iskeyword(stem) or stem in _RESERVED:
        raise UsageError(
            f"{stem}: names in {language} are letters, digits and _, and not a word of the language; choose such a name, like "
            "DriveConstants"
        )


def _literal(value: float, text: str | None = None) -> str:
    """A number as all three languages take it for a floating-point one."""
    shown = text or f"{value:.6g}"
    return shown if any(mark in shown for mark in ".en") else f"{shown}.0"
