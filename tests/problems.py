"""The problems that benchmarks solve end to end, for small versions of them."""

import importlib
import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "benchmarks"))
of = importlib.import_module("inversion_problems")
