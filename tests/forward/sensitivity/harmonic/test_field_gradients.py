"""Fields along which a body changes alike are found, and only those."""

import ngsolve as ngs
import numpy as np
import pytest
from waves import square

from ngbrain.forward.harmonic.problem import HarmonicProblem
from ngbrain.forward.harmonic.wave import Wave
from ngbrain.forward.sensitivity.harmonic.field_gradients import proportional_fields
from ngbrain.forward.sensitivity.harmonic.wave_model import WaveModel
from ngbrain.materials import Shearing

OMEGA = 2 * np.pi * 60


def fields(mesh, space=ngs.H1, **values):
    found = {}
    for name, value in values.items():
        found[name] = ngs.GridFunction(space(mesh))
        found[name].vec[:] = value
    return found


def body(mesh, law):
    return HarmonicProblem(mesh, law, [Wave(60.0, {"top": (1e-3, 0)})], bulk=9e3, form="P2", dirichlet="bottom|top")


def test_the_loss_modulus_goes_with_the_storage_modulus_and_a_viscosity_by_the_frequency():
    mesh = square(2, 0.04)
    of = fields(mesh, mu=2000.0, eta=3.0, loss=500.0)
    law = lambda omega: Shearing(of["mu"] + 1j * of["loss"] + 1j * omega * of["eta"])  # noqa: E731
    before = {name: field.vec.FV().NumPy().copy() for name, field in of.items()}
    found = proportional_fields(body(mesh, law), of, OMEGA)
    assert {name: first for name, (first, _) in found.items()} == dict.fromkeys(of, "mu")
    assert [r for _, r in found.values()] == pytest.approx([1, 1j * OMEGA, 1j])
    assert all(np.array_equal(field.vec.FV().NumPy(), before[name]) for name, field in of.items())


@pytest.mark.parametrize("tangent", [0.3, 0.0])
@pytest.mark.parametrize("space", [ngs.H1, ngs.NumberSpace])
def test_fields_that_are_alike_only_where_they_begin_are_told_apart(space, tangent):
    """Where they are uniform, nothing, or one number each, slopes are multiples of one another."""
    mesh = square(2, 0.04)
    for law in (
        lambda s, t: Shearing(s * (1 + 1j * t)),
        lambda s, t: Shearing(s * (1 + 1j * t * t / 2)),
        lambda s, t: Shearing(s + 1j * 2000 * t + 1j * t * t),
    ):
        of = fields(mesh, space, storage=2000.0, tangent=tangent)
        found = proportional_fields(body(mesh, law(*of.values())), of, OMEGA)
        assert [first for first, _ in found.values()] == list(of)


def test_a_field_that_nothing_is_made_of_has_no_slope():
    mesh = square(2, 0.04)
    of = fields(mesh, storage=2000.0, idle=1.0)
    model = WaveModel(body(mesh, Shearing(of["storage"] * (1 + 0.2j))), of, np.array([[0.01, 0.02]]))
    there = model.evaluate(model.theta)
    slope = there.gradient(there.data)
    assert np.abs(slope[model.blocks["storage"]]).max() > 0 and not slope[model.blocks["idle"]].any()
    assert slope == pytest.approx(there.vjp(there.data), rel=1e-9, abs=1e-30)
