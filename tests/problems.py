"""The inverse problems of the benchmarks, in small versions."""

import importlib
import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "benchmarks"))
of = importlib.import_module("inversion_problems")
