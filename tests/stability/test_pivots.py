"""Displacements that no tissue has. Naive: a shifted factor without pivots, refined by GMRES. Ours: pivots where that fails.

One component along an ultrasound beam, as of columns that do not hold on to each other: moduli that fit it vary by powers of
ten, and the multipliers of the equilibrium are determined by 1e-10. The naive residual stays above 1e-6, and the inversion ends
with an error; with pivots it is below 1e-7.
"""

import numpy as np
import pytest

from ngbrain.errors import SolverError
from ngbrain.inverse.elastography.invert import invert
from ngbrain.inverse.optimise import kkt
from ngbrain.io.waves import WaveData


@pytest.fixture(scope="module")
def columns():
    line = np.linspace(0, 38e-3, 67)
    x, y = (part.ravel() for part in np.meshgrid(line, line))
    strain = 0.01 / (1 + 2.0 * (np.hypot(x - 19e-3, y - 19e-3) < 5e-3))
    u = np.full((1, len(x), 2), np.nan, complex)
    u[0, :, 1] = -np.cumsum(strain.reshape(67, 67), axis=0).ravel() * (line[1] - line[0])
    u[0, :, 1] += 2e-6 * np.random.default_rng(0).normal(size=len(x))
    return WaveData(np.stack([x, y], axis=1), u, [0.0], 1000.0, "isotropic", "elastic", poisson=0.49)


def ends(data):
    return invert(data, uniform=False, max_iterations=1, model_error=0.02)


def test_naive_without_pivots(columns, monkeypatch):
    factorise = kkt.KKTSystem._factorise
    monkeypatch.setattr(kkt.KKTSystem, "_factorise", lambda system, pivoted=False: factorise(system))
    with pytest.raises(SolverError, match="optimality conditions are singular"):
        ends(columns)


class Enough(Exception):
    """The rest of the inversion tells nothing more."""


def test_pivots_where_refinement_fails(columns, monkeypatch):
    refined, residuals = kkt.KKTSystem._refined, []

    def measured(system, b, tolerance):
        x = refined(system, b, tolerance)
        if x is not None:
            residuals.append(float(np.linalg.norm(b - system._matrix @ x) / np.linalg.norm(b)))
            if system._pivoted:
                raise Enough
        return x

    monkeypatch.setattr(kkt.KKTSystem, "_refined", measured)
    with pytest.raises(Enough):
        ends(columns)
    print(f"residual with pivots {residuals[-1]:.1e}, before up to {max(residuals[:-1]):.1e}")
    assert residuals[-1] < 1e-7
