"""A motor whose parameters are known, as a result's plain data."""

from typing import Any

import pytest

from servobench.export.summary import ResultSummary

GAIN, TAU, DELAY, COULOMB = 23.7, 0.0992, 0.0004, 0.16
SD = {"gain": 0.02, "time_constant": 0.0003, "coulomb_voltage": 0.002, "delay": 0.0001}


def document(**changed: Any) -> dict[str, Any]:
    """Return a result of the first-order motor with friction, with some of its entries changed."""
    values = {"gain": GAIN, "time_constant": TAU, "coulomb_voltage": COULOMB, "delay": DELAY}
    units = {"gain": "rad/(s·V)", "time_constant": "s", "coulomb_voltage": "V", "delay": "s"}
    return {
        "schema": "servobench.result/1",
        "verdict": "trusted",
        "findings": [],
        "structure": "first_order_coulomb",
        "estimator": "output_error",
        "parameters": {
            name: {
                "value": value,
                "sd": SD[name],
                "interval": [value - 1.959964 * SD[name], value + 1.959964 * SD[name]],
                "level": 0.95,
                "unit": units[name],
            }
            for name, value in values.items()
        },
        "covariance": {
            "parameters": list(values),
            "matrix": [
                [
                    SD[a] * SD[b] * (1.0 if a == b else 0.4 if {a, b} == {"gain", "time_constant"} else 0.0)
                    for b in SD
                ]
                for a in SD
            ],
        },
        "transfer_function": {
            "numerator": [GAIN],
            "denominator": [TAU, 1.0],
            "output": "speed",
            "delay": DELAY,
            "unit": "rad/(s·V)",
        },
        "operating_range": {"input": [-3.0, 3.0], "speed": [-66.0, 66.0]},
        "provenance": {"version": "0", "created": "2026-01-01T00:00:00+00:00", "inputs_sha256": []},
        **changed,
    }


def known_together() -> dict[str, Any]:
    """Return a result that knows the time constant with the delay only, at most a friction, and the gain at one place."""
    made = document()
    for name in made["parameters"]:
        made["parameters"][name]["state"] = "known"
    made["parameters"]["time_constant"] |= {"state": "combination", "combination": "lag"}
    made["parameters"]["coulomb_voltage"] |= {"state": "bounded", "interval": [-0.3, 0.41]}
    made["combinations"] = {
        "lag": {
            "value": 0.0996,
            "sd": 0.001,
            "interval": [0.0976, 0.1016],
            "level": 0.95,
            "unit": "s",
            "meaning": "time constant + delay",
            "parameters": ["time_constant", "delay"],
        }
    }
    local = (
        "The input stayed at 3 V: the gain and the offset hold at this operating point only; "
        "record other levels for a wider range."
    )
    made["findings"] = [{"code": "gain-local", "severity": "info", "sentence": local}]
    return made


@pytest.fixture
def answer() -> ResultSummary:
    return ResultSummary.from_document(document(), "the result")
