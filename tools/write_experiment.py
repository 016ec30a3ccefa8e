"""Write docs/reference/experiment.md from the models that read an experiment's file; a test holds the page equal to this."""

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from types import UnionType
from typing import Any, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from servobench.cli.catalogue import default_text, meaning
from servobench.core.registry import Registry
from servobench.core.settings import unit_of
from servobench.rig.devices.base import DEVICES
from servobench.rig.devices.faults.base import FAULTS
from servobench.rig.experiment.experiment import DeviceChoice, Experiment, WhenLate
from servobench.rig.experiment.limits import Limits
from servobench.rig.experiment.reading import _ExperimentTable
from servobench.systems.control.base import CONTROLLERS
from servobench.systems.signals.base import SIGNALS

PAGE = Path(__file__).resolve().parent.parent / "docs" / "reference" / "experiment.md"

HEAD = """# The experiment's file

<!-- Written by tools/write_experiment.py from the models that read the file: change those, run `make generate`. -->

A file in [TOML](https://toml.io) that `servobench run` carries out, and that the folder of each run holds. Only
`[signal]` has to be there; what is left out has the default below. A number without a unit is in the unit that stands
beside it, and a text may have another unit of the same quantity: `0.002`, `"2 ms"`. A mistake is told with its line
before anything moves.
"""

EXAMPLE = """
```toml
[experiment]
duration = "10 s"
sample_rate = "500 Hz"

[signal]
type = "square"
low = "1 V"
high = "3 V"
frequency = "0.4 Hz"

[limits]
voltage = "5 V"
stall = "off"

[limits.watchdog]
timeout = "50 ms"
```

`examples/` has more of them.
"""

SIGNAL = """What the controller follows; in open loop it is the voltage. Where V stands here, the unit is the one that the
controller follows: V, rad or rad/s. `type` names the signal (`servobench signals`), the other keys are its settings.
Signals that are made of others take an array of such tables, `[[signal.parts]]` or `[[signal.segments]]`."""

CONTROLLER = """What turns the signal and a sample into a voltage. `type` names the controller (`servobench controllers`), the
other keys are its settings; without the table it is `open_loop`. [`servobench tune`](commands.md#tune) finds gains."""

FAULTY = """Faults to inject on purpose, a table each; the first acts nearest to the motor. `name` names the fault (`servobench
faults`), the other keys are its settings. The recording and its result say so. A fault that the device can't have is
refused."""

LIMITED = """What the device must not be asked for, what ends a run, and what each output is put to. Voltage and slew are kept by
clipping; the others are faults, after which the motor stands until they are acknowledged. [What that promises, and
what not](safety.md)."""

LATE = "What is done about ticks that have gone by, where the computer keeps the time."


def page() -> str:
    """Return the page."""
    return "\n".join([HEAD.rstrip(), EXAMPLE.rstrip(), "", *_sections()])


def _sections() -> Iterator[str]:
    """The lines of all tables of the file, in the order in which a file has them."""
    own = {
        key: Experiment.model_fields.get(key, field) for key, field in _ExperimentTable.model_fields.items()
    }
    yield from _section("[experiment]", "How long, how often, and what is to be made of it.", own)
    yield from _members("[signal]", SIGNAL, SIGNALS)
    yield from _members("[controller]", CONTROLLER, CONTROLLERS)
    device = {"name": DeviceChoice.model_fields["name"]}
    yield from _section("[device]", "The device to run it on (`servobench devices`).", device)
    yield from _members(
        "[device.settings]", "The settings of that device.", DEVICES, lambda kind: kind.Settings
    )
    yield from _members("[[device.faults]]", FAULTY, FAULTS)
    yield from _section("[limits]", LIMITED, Limits.model_fields)
    for key, field in Limits.model_fields.items():
        inner = _table_in(field)
        if inner is not None:
            yield from _section(
                f"[limits.{key}]", _as_in_a_file(field.description or ""), inner.model_fields, field
            )
    yield from _section(
        "[when_late]",
        LATE,
        WhenLate.model_fields,
    )


def _section(
    heading: str, sentence: str, fields: dict[str, FieldInfo], parent: FieldInfo | None = None
) -> Iterator[str]:
    """A table of the file: its heading, a sentence, and its keys; the defaults are those that it has in its parent."""
    yield from (f"## {heading}", "", sentence, "")
    yield from _rows(fields, parent.get_default() if parent is not None else None)
    yield ""


def _members(
    heading: str,
    sentence: str,
    kind: Registry[Any],
    settings: Callable[[Any], type[BaseModel]] = lambda member: member,
) -> Iterator[str]:
    """A table of the file whose keys depend on which member it names: what each is, and its keys."""
    yield from (f"## {heading}", "", sentence, "")
    for name in kind.names():
        yield from (f"### {name}", "", kind.sentence(name), "")
        fields = settings(kind[name]).model_fields
        yield from _rows(fields)
        yield ""
        for key, field in fields.items():
            for inner in get_args(field.annotation):
                if isinstance(inner, type) and issubclass(inner, BaseModel):
                    yield from (f"Each of the {key} has", "", *_rows(inner.model_fields), "")


def _rows(fields: dict[str, FieldInfo], values: BaseModel | None = None) -> Iterator[str]:
    yield from ("| key | default | unit | meaning |", "| --- | --- | --- | --- |")
    for name, field in fields.items():
        key, unit = field.alias or name, unit_of(field)
        inner = _table_in(field)
        default = default_text(field) if inner is None else f"see [limits.{key}](#limits{key})"
        if values is not None and getattr(values, name) != field.default:
            raise ValueError(f"{key} has another default there than in its own model; write it out")
        default = default.removesuffix(f" [{unit}]").removesuffix(f" {unit}") or "empty"
        yield f"| `{key}` | {default} | {unit} | {_as_in_a_file(meaning(field))} |".replace("|  |", "| |")


def _table_in(field: FieldInfo) -> type[BaseModel] | None:
    """The model of a field that is a table of its own, such as `stall`."""
    union = get_origin(field.annotation) is UnionType
    for each in get_args(field.annotation) if union else (field.annotation,):
        if isinstance(each, type) and issubclass(each, BaseModel):
            return each
    return None


def _as_in_a_file(sentence: str) -> str:
    """A sentence in the words of a file, which has no None."""
    return re.sub(r'None \(in a file ("\w+")\)', r"\1", sentence).replace("|", "\\|")


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8", newline="\n")
