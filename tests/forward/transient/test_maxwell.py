"""Maxwell branches in a body: tangent, forces, agreement with hereditary ones at small strain, order in time, restart."""

import ngsolve as ngs
import numpy as np
import pytest
from netgen.occ import Box, Glue, OCCGeometry, Z
from plate_contact import PRESS, run

from ngbrain.adjoint.check import taylor
from ngbrain.forward.common.material import Material
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.transient.step_control import StepControl
from ngbrain.forward.transient.time_stepper import TimeStepper
from ngbrain.materials import Branch, Maxwell, NeoHooke, Ogden, Viscous

FLOWING = Viscous(Ogden(300.0, -12.0), (Maxwell(Ogden(700.0, -15.0), 2100.0), Maxwell(NeoHooke(500.0), 1e5)))


@pytest.fixture
def flowed(make_body, plate, rng):
    """A body with inner states of its own, unknowns that are neither small nor special, and a direction."""
    drive = plate((0, 1), (0, 1e-3))
    body = make_body(FLOWING, contacts=[drive.contact(1e6)])
    drive.set(1.0)
    size = np.where(body.is_u, 2e-4, 50.0) * (body.weights > 0)
    before, x, dx = (size * rng.standard_normal(body.fes.ndof) for _ in range(3))
    body.begin(1.5)
    body.residual(before)
    body.history.finish()
    body.begin(0.7)
    return body, before + x, dx


def test_residual_is_the_gradient_of_the_least_energy(flowed):
    body, x, dx = flowed

    def energy(y):
        body.residual(y)
        return body.form.Energy(body.gfu.vec)

    rates = taylor(energy, body.residual(x)[0], x, dx, first=1e-3)
    assert np.all(np.abs(rates - 2) < 0.1), rates


def test_tangent_is_the_derivative_of_the_residual(flowed):
    body, x, dx = flowed
    r = body.residual(x)[0]
    body.tissue.stiffen()
    body.form.AssembleLinearization(body.gfu.vec)
    direction, product = body.gfu.vec.CreateVector(), body.gfu.vec.CreateVector()
    direction.FV().NumPy()[:] = dx
    product.data = body.form.mat * direction
    slope = product.FV().NumPy().copy() * (body.weights > 0)
    rates = taylor(lambda y: body.residual(y)[0], lambda _: slope, x, dx, first=1e-3)
    assert np.all(np.abs(rates - 2) < 0.1), rates
    body.form.Apply(body.gfu.vec, product)  # the energy's own derivative, once more where it was
    body.residual(x)
    body.form.Apply(body.gfu.vec, product)
    assert product.FV().NumPy() * (body.weights > 0) == pytest.approx(r, rel=1e-9, abs=1e-9 * np.abs(r).max())


def test_tissue_forces_are_those_of_the_state_that_stands(flowed):
    body, x, _ = flowed
    body.residual(x)
    there = body.tissue_forces()
    body.residual(0.5 * x)
    body.x = x
    assert body.tissue_forces() == pytest.approx(there, rel=1e-9, abs=1e-9 * np.abs(there).max())


def test_a_body_has_no_forces_before_its_first_step(make_body):
    body = make_body(FLOWING)
    assert np.abs(body.tissue_forces()).max() < 1e-12


def test_a_region_without_branches_is_not_touched_by_one_with(rng):
    low, high = Box((0, 0, 0), (0.02, 0.02, 0.01)), Box((0, 0, 0.01), (0.02, 0.02, 0.02))
    low.mat("low"), high.mat("high")
    low.faces.Min(Z).name = "bottom"
    mesh = ngs.Mesh(OCCGeometry(Glue([low, high])).GenerateMesh(maxh=0.008))
    stiff, soft = Material(NeoHooke(400.0), 1e5), Material(FLOWING, 1e5)
    one, both = (
        Problem(mesh, {"low": stiff, "high": upper}, {"bottom": 0}, element="P2/P1", history=True)
        for upper in (soft, stiff)
    )
    x = np.where(one.is_u, 2e-4, 20.0) * rng.standard_normal(one.fes.ndof) * (one.weights > 0)
    forces = []
    for body in (one, both):
        body.begin(0.5)
        forces.append(body.residual(x)[0])
    below = np.ones(one.fes.ndof, bool)
    for element in mesh.Elements():
        if element.mat == "high":
            below[list(one.fes.GetDofNrs(element))] = False
    scale = np.abs(forces[0]).max()
    assert forces[0][below] == pytest.approx(forces[1][below], abs=1e-12 * scale)
    assert np.abs(forces[0] - forces[1])[~below].max() > 1e-2 * scale


def test_small_strains_flow_as_hereditary_branches_relax(make_body, plate):
    forces = []
    for branches in (
        (Maxwell(NeoHooke(700.0), 2100.0), Maxwell(Ogden(500.0, -9.0), 1e5)),
        (Branch(NeoHooke(700.0), 3.0), Branch(Ogden(500.0, -9.0), 200.0)),
    ):
        drive = plate((0, 4, 40), (0, 4e-5, 4e-5))
        body = make_body(Viscous(NeoHooke(300.0), branches), [drive.contact()])
        forces.append(run(body, drive, StepControl(1.0, dt_max=10))[1][:, 1])
    flowing, hereditary = forces
    assert flowing == pytest.approx(hereditary, rel=3e-3)
    assert flowing != pytest.approx(hereditary, rel=1e-9)


def test_a_step_is_second_order_in_time(make_body, plate):
    law = Viscous(NeoHooke(300.0), (Maxwell(NeoHooke(700.0), 2100.0),))
    forces = []
    for dt in (2.0, 1.0, 0.5, 0.0625):
        drive = plate((0, 4), (0, 3e-3))
        body = make_body(law, [drive.contact()])
        forces.append(run(body, drive, StepControl(dt, first=1.0, touch_growth=1.0))[1][-1, 1])
    errors = np.abs(np.array(forces[:-1]) / forces[-1] - 1)
    rates = np.log2(errors[:-1] / errors[1:])
    assert errors[0] < 0.02 and np.all(rates > 1.7), (errors, rates)


@pytest.mark.one_thread
def test_restart_goes_on_to_the_same_bits(make_body, plate):
    def made():
        drive = plate(*PRESS)
        return TimeStepper(make_body(FLOWING, [drive.contact()]), drive, StepControl(1.0, dt_max=10), 1e-3)

    whole, half, other = made(), made(), made()
    whole.run(lambda *_: None)
    half.run(lambda *_: None, until=20.0)
    other.restore(half.checkpoint())
    other.run(lambda *_: None)
    assert np.array_equal(other.problem.x, whole.problem.x)
    assert np.array_equal(other.problem.history.maxwell.branches[0].G, whole.problem.history.maxwell.branches[0].G)
