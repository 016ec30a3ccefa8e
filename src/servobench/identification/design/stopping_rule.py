"""When to stop: a run goes on until gain or time constant is known as well as requested.

The recording so far is identified again and again, each time after it has grown by a fifth, and the run ends once the verdict is
trusted and each 95 % interval named is narrow enough. Stopping at the first narrow interval favours intervals that are narrow
by chance; with so few looks the effect is too small to show in a hundred runs (docs/decisions/0015-design.md).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from servobench.core.errors import NotIdentifiable, UnknownName, UsageError
from servobench.core.finding import Verdict
from servobench.core.parameter_names import parameter_in_words
from servobench.identification.result import Result
from servobench.recordings.recording import Recording

NAMES = ("gain", "time_constant")
FIRST = 2.0  # s of the run before the first look
GROWTH = 1.2  # times as much data at the next look


def parse_wish(text: str) -> Mapping[str, float]:
    """Return the relative half-widths wished for: `gain=0.1%, time_constant=0.5%` is {"gain": 0.001, "time_constant": 0.005}.

    Raises `UnknownName` for another parameter, `UsageError` for a text that isn't like that.
    """
    wished: dict[str, float] = {}
    for part in text.split(","):
        name, equals, amount = (piece.strip() for piece in part.partition("="))
        if not equals or not amount.endswith("%"):
            raise UsageError(
                f"until {text!r}: {part.strip()!r} isn't a target; expected, for example, time_constant=0.5%"
            )
        if name not in NAMES:
            raise UnknownName("parameter to wait for", name, NAMES)
        try:
            share = float(amount[:-1]) / 100
        except ValueError:
            raise UsageError(
                f"until {text!r}: {amount[:-1].strip()!r} isn't a number; expected, for example, 0.5%"
            ) from None
        if not (math.isfinite(share) and share > 0):
            raise UsageError(f"until {text!r}: {amount} can't be reached; expected more than 0 %")
        wished[name] = share
    return wished


@dataclass
class StoppingRule:
    """Looks at the recording so far, and says when it is enough: what `run` takes as `look`.

    `wished` are half-widths of 95 % intervals over the values; `chain` and `structure` as for `measure` and `identify`.
    """

    wished: Mapping[str, float]
    chain: str = ""
    structure: str = "auto"
    looks: int = 0
    _next: float = field(default=FIRST, init=False)

    def __call__(self, recording: Recording) -> str | None:
        """Return the sentence with which the run is to end, None where it is to go on."""
        from servobench.identification.identify import identify
        from servobench.recordings.measurement.measure import measure

        t = recording["counts"].t
        if t is None or not len(t) or t[-1] - t[0] < self._next:
            return None
        length = float(t[-1] - t[0])
        self._next = GROWTH * length
        self.looks += 1
        try:
            result = identify(measure(recording, self.chain), structure=self.structure)
        except NotIdentifiable:
            return None
        if not self.is_met(result):
            return None
        return (
            f"stopped after {length:g} s, when the target interval was reached: {self.progress_text(result)}"
        )

    def progress_text(self, result: Result) -> str:
        """Return in words how well a result knows each parameter wished for, and its verdict where that isn't trusted."""
        parts = []
        for name in self.wished:
            share = half(result, name)
            how = f"± {100 * share:.2g} %" if math.isfinite(share) else "not known"
            parts.append(f"{parameter_in_words(name)} {how}")
        verdict = "" if result.verdict is Verdict.TRUSTED else f", and the result is {result.verdict}"
        return f"{' and '.join(parts)}{verdict}"

    def is_met(self, result: Result) -> bool:
        """Return whether a result is trusted and knows each parameter as well as wished."""
        if result.fit is None or result.verdict is not Verdict.TRUSTED:
            return False
        return all(half(result, name) <= share for name, share in self.wished.items())


def half(result: Result, name: str) -> float:
    """Return half of a parameter's 95 % interval over its value; infinite where there is none."""
    if result.fit is None or name not in result.fit.estimates:
        return math.inf
    estimate = result.fit[name]
    if estimate.value == 0 or not all(map(math.isfinite, estimate.interval)):
        return math.inf
    return 0.5 * (estimate.interval[1] - estimate.interval[0]) / abs(estimate.value)
