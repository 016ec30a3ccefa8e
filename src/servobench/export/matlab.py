"""MATLAB and Octave: a `.mat` file of the numbers, and a `.m` file that makes a `tf` of them."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from servobench.core.errors import UsageError
from servobench.export.base import TARGETS, Wishes
from servobench.export.summary import ResultSummary

_TEXT = """\
%% The identified motor, from {input_unit} to {position}/s.
{comment}
% {stem}.mat holds the same numbers, and the covariance of the parameters.

numerator = [{numerator}];
denominator = [{denominator}];
delay = {delay}; % s

% value, standard deviation, low and high end of the 95 % interval
{parameters}

% The control toolbox has tf; Octave's (pkg load control) has no InputDelay: there the delay is separate.
if exist('OCTAVE_VERSION', 'builtin')
    motor = tf(numerator, denominator, 'InputName', 'input', 'OutputName', 'speed');
else
    motor = tf(numerator, denominator, 'InputDelay', delay, 'InputName', 'input', 'OutputName', 'speed');
end
% With the identification toolbox: idtf(motor).
"""


@TARGETS.member("matlab")
class Matlab:
    """A struct `motor` in a .mat file (version 5), and a .m file beside it that makes a `tf` with its delay."""

    suffix: ClassVar[str] = ".m"
    wishes: ClassVar[frozenset[str]] = frozenset()

    def render(self, answer: ResultSummary, wishes: Wishes, stem: str) -> Mapping[str, bytes]:
        """Return both files; raises `UsageError` where the stem is no name that MATLAB can run."""
        if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,62}", stem):
            raise UsageError(
                f"{stem}.m: MATLAB runs only files whose name is a letter and then letters, digits and _; choose such a name"
            )
        return {f"{stem}.m": self._script(answer, stem).encode(), f"{stem}.mat": _variables(answer)}

    def _script(self, answer: ResultSummary, stem: str) -> str:
        system = answer.model
        position, driven_by = answer.units
        lines = [
            f"parameters.{name} = [{e.value!r}, {_number(e.sd)}, {_number(e.interval[0])}, {_number(e.interval[1])}]; % {e.unit}"
            for name, e in answer.estimates.items()
        ]
        return _TEXT.format(
            stem=stem,
            comment="\n".join(f"% {line}" for line in answer.model_comment),
            input_unit=driven_by,
            position=position,
            numerator=", ".join(map(repr, system.numerator)),
            denominator=", ".join(map(repr, system.denominator)),
            delay=repr(system.delay),
            parameters="\n".join(lines),
        )


def _variables(answer: ResultSummary) -> bytes:
    from scipy.io import savemat

    system = answer.model
    motor: dict[str, Any] = {
        "numerator": np.array([system.numerator]),
        "denominator": np.array([system.denominator]),
        "delay": system.delay,
        "unit": system.unit,
        "structure": answer.structure,
        "verdict": answer.verdict,
        "parameters": {
            name: {"value": e.value, "sd": e.sd, "interval": np.array([e.interval]), "unit": e.unit}
            for name, e in answer.estimates.items()
        },
        "covariance": answer.covariance,
        "covariance_of": np.array([[name] for name in answer.estimates], dtype=object),
        "notes": np.array([[line] for line in answer.model_comment], dtype=object),
    }
    content = io.BytesIO()
    savemat(content, {"motor": motor}, long_field_names=True)
    return content.getvalue()


def _number(value: float) -> str:
    return repr(value) if np.isfinite(value) else "NaN" if np.isnan(value) else "Inf" if value > 0 else "-Inf"
