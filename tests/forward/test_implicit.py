"""Derivatives of equilibria: Taylor rates for every law, form and kind of parameter; J against Jᵀ; symmetric second derivatives."""

import inspect

import numpy as np
import pytest
from equilibria import LAWS, directions, model, weights

from ngbrain import materials
from ngbrain.adjoint.check import taylor
from ngbrain.forward.elements import Form

FORMS = {"displacements": "P2", "continuous pressure": "P2/P1", "condensed pressure": Form(2, 0, False)}
RELAXING = {"Branch", "Flow", "Flows", "Maxwell", "Prony", "RelaxingPolynomial", "Viscous"}
"""Laws that equilibrium knows nothing of."""
OTHER = {"Deformation", "Law", "OgdenBranches"}


def test_every_law_is_here():
    names = {name for name in materials.__all__ if name[0].isupper() and not name.isupper()}
    assert names - RELAXING - OTHER == {law.__name__ for law in LAWS if law.__module__.startswith("ngbrain")}


@pytest.mark.parametrize("form", FORMS.values(), ids=FORMS)
@pytest.mark.parametrize("kind", ["field", "number"])
@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.__name__)
def test_rates_and_transposes(law, kind, form, rng):
    of = model(law, kind, form)
    theta = of.theta
    there = of.at(theta)
    w = weights(there, rng)
    pulled, driven = there.pull(w), there.gradient(w)
    scale = np.concatenate([np.full(b.stop - b.start, np.abs(pulled[b]).max()) for b in of.blocks.values()])
    assert np.abs((pulled - driven) / scale).max() < 1e-10
    unit = np.abs(there.data)
    for name, direction in directions(of, rng):
        change = there.push(direction)
        assert abs(w @ change - pulled @ direction) < 1e-10 * np.linalg.norm(w) * np.linalg.norm(change)
        rates = taylor(lambda t: of.at(t).data / unit, lambda _: change / unit, theta, direction, steps=2)  # noqa: B023
        assert np.all((rates > 1.9) & (rates < 2.1)), (name, rates)
