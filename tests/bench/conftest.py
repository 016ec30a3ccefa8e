"""The benches are no package: their folder joins the path, behind everything else."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parent.parent.parent / "bench"))
