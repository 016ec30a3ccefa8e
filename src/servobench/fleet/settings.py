"""The settings for each recording of many: the same for all of them, and kept with the results."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from servobench.core.errors import UsageError

if TYPE_CHECKING:
    from servobench.identification.result import Result
    from servobench.recordings.evidence import Evidence


@dataclass(frozen=True, kw_only=True)
class Settings:
    """The settings for each file; `options` are those of `ReadingOptions`, the rest is as for `identify`.

    Raises `UsageError` for several stated inputs.
    """

    options: Mapping[str, Any] = field(default_factory=dict)
    structure: str = "auto"
    """The name of the model structure, or auto."""
    estimator: str = "auto"
    """The name of the method, or auto."""
    nominal: str | None = None
    """The name of a data sheet to compare with."""
    known: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Known parameters of the motor, each with its standard deviation, in SI units."""
    starts_at_rest: bool = False
    """Whether the motor is at rest when each record begins."""

    def __post_init__(self) -> None:
        values = self.options.get("input_value")
        if isinstance(values, list | tuple) and len(values) > 1:
            raise UsageError(
                f"`input_value=...` is given {len(values)} times; files that are identified one by one share one value, or "
                "have it in their names: `input_value={level}pwr:%`"
            )

    def identify(self, path: Path) -> tuple[list[Evidence], Result]:
        """Return the recordings in a file as they were read, and the result of all of them.

        Raises what `load` and `identify` raise.
        """
        from servobench.identification.identify import identify_evidence
        from servobench.recordings.evidence import Evidence
        from servobench.recordings.loading.load import load
        from servobench.recordings.reading import evidence_in

        parts = evidence_in(list(load(path)), **self.options)
        evidence = [part for part in parts if isinstance(part, Evidence)]
        result = identify_evidence(
            evidence,
            self.structure,
            self.estimator,
            self.nominal,
            known=self.known,
            starts_at_rest=self.starts_at_rest,
        )
        return evidence, result

    def check(self) -> None:
        """Raise `UsageError` for what is wrong whatever the files are: an option, the mapping file, the chain."""
        from servobench.recordings.measurement.base import Chain
        from servobench.recordings.reading import mapping_of

        Chain.parse(mapping_of(**self.options).chain)

    def to_dict(self) -> dict[str, Any]:
        """Return all of it as plain data: of the mapping file its text; raises `UsageError` where that can't be read."""
        chosen = {name: value for name, value in self.options.items() if value is not None}
        if "mapping" in chosen:
            chosen["mapping"] = _text_of(Path(chosen["mapping"]))
        return {
            "reading": {
                name: list(value) if isinstance(value, tuple) else value for name, value in chosen.items()
            },
            "structure": self.structure,
            "estimator": self.estimator,
            "nominal": self.nominal,
            "known": {name: list(value) for name, value in self.known.items()},
            "starts_at_rest": self.starts_at_rest,
        }


def _text_of(path: Path) -> str:
    from servobench.recordings.formats.mapping import Mapping as ColumnMapping

    ColumnMapping.read(path)
    return path.read_text(encoding="utf-8")
