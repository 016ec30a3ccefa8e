from dataclasses import replace

import numpy as np

from servobench.report.speed import eye_speed, eye_window

from .conftest import QUANTUM, dataset
