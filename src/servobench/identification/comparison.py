"""The verb compare: models side by side on data, in a picture and in numbers.

The fit in percent is that of Ljung, System Identification (1999), section 16.4: one less the relative root mean square error.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Unpack

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import UsageError
from servobench.core.plotting import ground, lay_out, new_axes
from servobench.identification.estimators.output_error import simulate_record
from servobench.identification.result import Result
from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.reading import ReadingOptions, datasets_in

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, kw_only=True, eq=False)
class Simulated:
    """One model on one record: its simulated output y (M,), in the unit of the record, and how well that fits.

    `fit_percent` is 100 (1 - |measured - y| / |measured - mean|), 100 for a perfect model and 0 for the mean.
    """

    model: str
    record: Dataset
    y: Array
    fit_percent: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Compared:
    """Models on records: `simulations` of each model on each record."""

    simulations: tuple[Simulated, ...]

    def plot(self, axes: Axes | Sequence[Axes] | None = None, *, dark: bool = False) -> Sequence[Axes]:
        """Draw measured and simulated output over time [s], an axes for each record; return them."""
        records = list(dict.fromkeys(each.record for each in self.simulations))
        panels = new_axes(axes, len(records), dark)
        palette = ground(dark)
        for ax, record in zip(panels, records, strict=True):
            ax.plot(record.t_output, record.y, color=palette.measured, linewidth=2.6, label="measured")
            for each in self.simulations:
                if each.record is record:
                    ax.plot(
                        record.t_output,
                        each.y,
                        linewidth=1.3,
                        label=f"{each.model}: {each.fit_percent:.1f} %",
                    )
            title = record.name if len(records) > 1 else ""
            lay_out(ax, palette, "time (s)", f"{record.kind} ({record.output_unit})", title)
            ax.legend(frameon=False, labelcolor=palette.ink)
        return panels

    def __str__(self) -> str:
        """A line for each model and record, the best first."""
        ranked = sorted(self.simulations, key=lambda each: -each.fit_percent)
        return "\n".join(f"{each.fit_percent:6.1f} %  {each.model} on {each.record.name}" for each in ranked)

    __repr__ = __str__


def compare(
    models: Result | Mapping[str, Result],
    data: object = None,
    *,
    starts_at_rest: bool = False,
    **options: Unpack[ReadingOptions],
) -> Compared:
    """Return how well results simulate data, from the input alone, with the start of each record fitted.

    `models` is a result, or a mapping of names to results. `data` are read as by `identify`; by default all
    results are compared on the data of the first one. Raises `UsageError` for an object that isn't a result,
    a result without a model, and data in other units.

    >>> import numpy as np
    >>> from servobench import identify
    >>> t = np.arange(0, 2, 0.002)
    >>> u = np.where(t % 1 < 0.5, 2.0, 4.0)
    >>> y = np.zeros(len(t))
    >>> for k in range(len(t) - 1):
    ...     y[k + 1] = y[k] + (1 - np.exp(-0.02)) * (20 * u[k] - y[k])
    >>> arrays = dict(t=t, u=u, y=y, input_unit="V", output_unit="rad/s", chain="none")
    >>> compare({"mine": identify(**arrays)}, **arrays)
     100.0 %  mine on arrays
    """
    named = models if isinstance(models, Mapping) else {"model": models}
    for name, result in named.items():
        if not isinstance(result, Result) or result.fit is None:
            raise UsageError(
                f"{name} is {type(result).__name__} without a model; expected a result of identify() that wasn't refused"
            )
    if not named:
        raise UsageError("models is empty; expected a Result, or a dict of several by name")
    if data is None and not options:
        records = next(iter(named.values())).data
    else:
        records = datasets_in(data, starts_at_rest=starts_at_rest, **options)
    return Compared(
        simulations=tuple(
            _simulation(name, result, record) for name, result in named.items() for record in records
        )
    )


def _simulation(name: str, result: Result, record: Dataset) -> Simulated:
    model = result._require_fit().model
    own = model.data
    if (own.input_unit, own.position_unit) != (record.input_unit, record.position_unit):
        raise UsageError(
            f"{name} goes from {own.input_unit} to {own.position_unit}, but {record.name} from {record.input_unit} to "
            f"{record.position_unit}: give data in the model's units"
        )
    simulation = simulate_record(model.structure, model.theta, record)
    measured, left = record.y[simulation.valid], simulation.residual[simulation.valid]
    spread = float(np.linalg.norm(measured - measured.mean()))
    fit = 100 * (1 - float(np.linalg.norm(left)) / spread) if spread else np.nan
    return Simulated(
        model=name,
        record=record,
        y=np.where(simulation.valid, simulation.prediction, np.nan),
        fit_percent=fit,
    )
