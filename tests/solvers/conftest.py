"""A GPU that is none, for every test of solvers."""

import pytest
from host_cudss import install


@pytest.fixture(autouse=True)
def cudss(monkeypatch):
    """The class of its solver, which counts."""
    return install(monkeypatch)
