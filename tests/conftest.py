"""One thread, no chatter and a fixed seed for every test."""

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # read once, when numpy and ngsolve are loaded

import ngsolve
import numpy as np
import pytest

ngsolve.ngsglobals.msg_level = 0
ngsolve.SetNumThreads(1)


@pytest.fixture
def rng() -> np.random.Generator:
    """Random numbers, the same ones in every run and in every test."""
    return np.random.default_rng(20260101)
