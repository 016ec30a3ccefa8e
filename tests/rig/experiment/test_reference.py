"""The reference of the experiment's file: every key that the models know, with the default that they have."""

import re
from typing import Any

import pytest

from servobench.rig.devices.base import DEVICES
from servobench.rig.devices.faults.base import FAULTS, fault_from
from servobench.rig.experiment import Experiment, read_experiment
from servobench.rig.experiment.reading import _File
from servobench.systems.control.base import CONTROLLERS
from servobench.systems.signals.base import SIGNALS
from tests.test_house import ROOT, tool

PAGE = (ROOT / "docs" / "reference" / "experiment.md").read_text(encoding="utf-8")
ROW = re.compile(r"\| `(?P<key>\w+)` \| (?P<default>[^|]+) \| (?P<unit>[^|]*)\| .+ \|")
TABLES = ("experiment", "device", "limits", "when_late")
INNER = ("stall", "plausibility", "start", "terminate", "watchdog")


def rows(heading: str, member: str = "") -> dict[str, tuple[str, str]]:
    """Return the keys below a heading of the page, each with its default and its unit."""
    section = PAGE.partition(f"\n## {heading}\n")[2].partition("\n## ")[0]
    if member:
        section = section.partition(f"\n### {member}\n")[2].partition("\n### ")[0]
    assert section, f"the page has no section on {member or heading}: run `make generate`"
    found = [match for line in section.splitlines() if (match := ROW.fullmatch(line))]
    return {match["key"]: (match["default"], match["unit"].strip()) for match in found}


def as_toml(found: dict[str, tuple[str, str]]) -> str:
    """Return the lines of a table in which everything that has a default is set to it."""
    lines = []
    for key, (default, unit) in found.items():
        if default in {"not set", "required"} or default.startswith("see "):
            continue
        values = [] if default == "empty" else [f"{part} {unit}".strip() for part in default.split(", ")]
        plain = [
            part if re.fullmatch(r"-?\d+(\.\d+)?(e-\d+)?|true|false", part) else f'"{part}"'
            for part in values
        ]
        lines.append(
            f"{key} = " + (plain[0] if len(plain) == 1 else '""' if not plain else f"[{', '.join(plain)}]")
        )
    return "\n".join(lines) + "\n"


def test_the_page_is_what_the_models_say() -> None:
    assert tool("write_experiment").page() == PAGE, "run make generate"


def test_every_key_that_a_file_may_have_stands_on_the_page() -> None:
    """By the schema of the model that reads files, which knows nothing of the tool that writes the page."""
    schema = _File.model_json_schema()

    def keys(of: dict[str, Any]) -> set[str]:
        return set(schema["$defs"][of["$ref"].rpartition("/")[2]]["properties"])

    assert set(schema["properties"]) == {*TABLES, "signal", "controller"}
    for name in TABLES:
        known = keys(schema["properties"][name])
        assert known - {"settings", "faults"} == set(rows(f"[{name}]")), name
        for key in known & set(INNER):
            inner = schema["$defs"]["Limits"]["properties"][key]
            assert keys(inner.get("anyOf", [inner])[0]) == set(rows(f"[limits.{key}]")), key
    assert set(INNER) == {key for key, (default, _) in rows("[limits]").items() if default.startswith("see ")}


def test_a_file_with_all_the_defaults_on_the_page_is_the_experiment_without_any_of_them() -> None:
    signal = '[signal]\ntype = "square"\n' + as_toml(rows("[signal]", "square"))
    tables = [
        f"[{name}]\n{as_toml(rows(f'[{name}]'))}" for name in (*TABLES, *(f"limits.{key}" for key in INNER))
    ]

    assert read_experiment("\n".join([signal, *tables])) == Experiment()


@pytest.mark.parametrize("name", SIGNALS.names())
def test_the_defaults_of_a_signal_are_those_on_the_page(name: str) -> None:
    found = rows("[signal]", name)
    assert list(found)[: len(SIGNALS[name].model_fields)] == list(SIGNALS[name].model_fields)  # type: ignore[attr-defined]
    if "required" not in {default for default, _ in found.values()}:
        read = read_experiment(f'[signal]\ntype = "{name}"\n{as_toml(found)}').signal
        assert read == SIGNALS[name]()  # type: ignore[call-arg]


@pytest.mark.parametrize("name", CONTROLLERS.names())
def test_the_defaults_of_a_controller_are_those_on_the_page(name: str) -> None:
    text = f'[controller]\ntype = "{name}"\n{as_toml(rows("[controller]", name))}'

    assert read_experiment(f'[signal]\ntype = "constant"\n{text}').controller == CONTROLLERS[name]()


@pytest.mark.parametrize("name", FAULTS.names())
def test_the_defaults_of_a_fault_are_those_on_the_page(name: str) -> None:
    text = f'[[device.faults]]\nname = "{name}"\n{as_toml(rows("[[device.faults]]", name))}'
    (table,) = read_experiment(f'[signal]\ntype = "constant"\n{text}').device.faults
    assert set(table) - {"name"} <= set(rows("[[device.faults]]", name))
    if name != "lost":  # which needs one of its settings, as it would lose every sample
        assert fault_from(table) == FAULTS[name]()


@pytest.mark.parametrize("name", DEVICES.names())
def test_the_settings_of_a_device_are_those_on_the_page(name: str) -> None:
    assert list(rows("[device.settings]", name)) == list(DEVICES[name].Settings.model_fields)


def test_the_example_on_the_page_is_an_experiment() -> None:
    (example,) = re.findall(r"^```toml\n(.*?)^```$", PAGE, flags=re.DOTALL | re.MULTILINE)

    experiment = read_experiment(example)
    assert (experiment.sample_rate, experiment.limits.stall) == (500, None)
    assert experiment.limits.watchdog.timeout == 0.05
