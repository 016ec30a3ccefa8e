"""Experiments as data, in Python and in TOML files."""

from servobench.rig.experiment.experiment import PAPER, DeviceChoice, Experiment, WhenLate
from servobench.rig.experiment.limits import Limits
from servobench.rig.experiment.reading import explain, load_experiment, read_experiment

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
