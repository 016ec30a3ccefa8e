"""Experiments: what is asked for, as data, in Python and in TOML files."""

from servobench.experiment.experiment import PAPER, DeviceChoice, Experiment, WhenLate
from servobench.experiment.limits import Limits
from servobench.experiment.reading import explain, load_experiment, read_experiment

__all__ = [
    "PAPER",
    "DeviceChoice",
    "Experiment",
    "Limits",
    "WhenLate",
    "explain",
    "load_experiment",
    "read_experiment",
]
