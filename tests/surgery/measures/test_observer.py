"""Pressures on parts of a blade's face, for a known non-uniform loading of the wall."""

from dataclasses import replace

import ngsolve as ngs
import numpy as np
import pytest

from ngbrain.adjoint.check import taylor
from ngbrain.errors import InputError
from ngbrain.forward.common.material import Material
from ngbrain.forward.contact.rigid import RigidContact
from ngbrain.forward.observables import Patch
from ngbrain.forward.observables.patches import DrivingForce
from ngbrain.forward.observables.wall import WallPass
from ngbrain.forward.sensitivity.transient.run_model import RunModel
from ngbrain.forward.solid.problem import Problem
from ngbrain.materials import NeoHooke
from ngbrain.mesh import Cleft, block
from ngbrain.scene import Scene
from ngbrain.scene.operation import FACED
from ngbrain.surgery.measures.observer import CENTRE, PATCH_MARGIN, Observer, retraction_observables
from ngbrain.surgery.model import RetractionModel
from ngbrain.surgery.protocols import ToolMotion
from ngbrain.surgery.tools import Spatula, Tube

SIZE = (0.02, 0.04, 0.01)
TIP, WIDTH, DEPTH = 4e-3, 12e-3, 32e-3
PENALTY = 1e6
OUT, SLOT = np.array([0, 1.0, 0]), (DEPTH, 4e-3, 12e-3)


def observed(press):
    """Undeformed block with a blade on its top wall, which is raised by press(height above the tip) m."""
    target = np.array([SIZE[0] / 2, 0.004, SIZE[2] + 2e-3])
    cleft = Cleft(target, np.array([0, 1.0, 0]), np.array([0, 0, -1.0]), DEPTH, 4e-3, 12e-3)
    blade = Spatula(cleft, WIDTH, 1e-3, TIP, 2e-3)
    contact = RigidContact("top", blade.distance(ngs.CF(0.0)), PENALTY, 1e-9)
    body = Problem(
        block(SIZE, 2e-3), {"tissue": Material(NeoHooke(1e3), 1e5)}, {"bottom": 0}, contacts=[contact], element="P2/P1"
    )
    up = press(ngs.y - target[1] - TIP)
    body.u.Interpolate(ngs.CF((0, 0, up * ngs.z / SIZE[2])))
    return Observer(body, {"top": blade}, "bottom")(0.0, 0.0, 1.0)


def test_an_even_pressure_is_the_same_everywhere():
    row = observed(lambda height: ngs.CF(5e-5))
    assert row.depth == pytest.approx(5e-5, rel=0.01) and row.gap == pytest.approx(-5e-5, rel=0.01)
    assert [row.pressure, row.tip_pressure, row.centre_pressure] == pytest.approx([PENALTY * 5e-5] * 3, rel=1e-3)


def test_the_centre_is_a_disc_in_the_middle_of_the_patch_and_the_tip_its_end():
    """A pressure with the square of the distance from the middle: R²/4 in the mean over a disc, H²/12 over the patch."""
    low, high = PATCH_MARGIN, SIZE[1] - 0.004 - TIP  # the patch, in heights above the tip
    middle, length = (low + high) / 2, high - low
    row = observed(lambda height: 1e-6 + (height - middle) ** 2)
    assert row.pressure == pytest.approx(PENALTY * (1e-6 + length**2 / 12), rel=0.02)
    ends = (FACED - middle) ** 3 - (low - middle) ** 3
    assert row.tip_pressure == pytest.approx(PENALTY * (1e-6 + ends / 3 / (FACED - low)), rel=0.03)
    assert 2 * CENTRE < WIDTH - 2 * PATCH_MARGIN  # the whole disc is on the patch
    assert row.centre_pressure == pytest.approx(PENALTY * (1e-6 + CENTRE**2 / 4), rel=0.1)


def pressed_between(blade, sides):
    """A block fixed at one end, with blades on the named sides, all moved by one distance; it bulges by 1 % of the position."""
    way = ngs.Parameter(0.0)
    clefts = {
        "top": Cleft(np.array([SIZE[0] / 2, 0.004, SIZE[2] + 2e-3]), OUT, np.array([0, 0, -1.0]), *SLOT),
        "bottom": Cleft(np.array([SIZE[0] / 2, 0.004, -2e-3]), OUT, np.array([0, 0, 1.0]), *SLOT),
    }
    blades = {side: blade(clefts[side]) for side in sides}
    contacts = [
        RigidContact(side, one.distance(way / len(sides)), PENALTY, 1e-4, 0.9, way) for side, one in blades.items()
    ]
    body = Problem(
        block(SIZE, 4e-3), {"tissue": Material(NeoHooke(1e3), 1e5)}, {"back": 0}, contacts=contacts, element="P2/P1"
    )
    body.u.Interpolate(ngs.CF((0, 0, 0.01 * (ngs.z - SIZE[2] / 3))))
    body.offset.Set(1e-5 * (1 + ngs.y / SIZE[1]), definedon=body.mesh.Boundaries("|".join(sides)))
    return body, blades, way


def spatula(cleft):
    return Spatula(cleft, WIDTH, 1e-3, TIP, 2e-3)


def test_of_two_blades_pressures_are_of_both_patches_and_the_force_is_of_one():
    body, blades, _ = pressed_between(spatula, ("top", "bottom"))
    both = Observer(body, blades, "back")(0.0, 0.0, 1.0)
    top, bottom = (Observer(body, {side: blades[side]}, "back")(0.0, 0.0, 1.0) for side in ("top", "bottom"))
    assert top.pressure > 1.5 * bottom.pressure > 0
    assert both.pressure == pytest.approx(
        (top.pressure + bottom.pressure) / 2, rel=2e-3
    )  # patches end inside triangles
    assert both.force == pytest.approx((top.force + bottom.force) / 2)
    assert both.area == pytest.approx(top.area + bottom.area)
    assert both.opening == pytest.approx(top.opening + bottom.opening)


@pytest.mark.parametrize("blade", [spatula, lambda cleft: Tube(cleft, WIDTH, 1e-3, TIP)])
@pytest.mark.parametrize("sides", [("top",), ("top", "bottom")])
def test_what_moving_blades_takes_is_the_slope_of_the_contacts_energy(blade, sides):
    """For any shape: a tube presses on all sides, which the force along one direction does not include."""
    body, _, way = pressed_between(blade, sides)
    way.Set(2e-4)
    driving = WallPass(body, [DrivingForce([Patch(contact) for contact in body.contacts])])()[0]
    energies = []
    for at in (2.01e-4, 1.99e-4):
        way.Set(at)
        energies.append(body.contact_energy())
    assert driving > 0 and driving == pytest.approx((energies[0] - energies[1]) / 2e-6, rel=1e-5)


@pytest.mark.parametrize("blade", [spatula, lambda cleft: Tube(cleft, WIDTH, 1e-3, TIP)])
def test_a_blades_surface_moves_with_its_distance(blade, rng):
    """A point moving with the surface keeps its distance: ∂φ/∂a + ∇φ · ∂moves/∂a = 0, on faces and rounded edges."""
    cleft, advance = Cleft(np.zeros(3), OUT, np.array([0, 0, -1.0]), *SLOT), ngs.Parameter(1e-3)
    mesh = block((0.01, 0.03, 0.01), 0.01)
    x = ngs.CF((ngs.x - 0.005, ngs.y, ngs.z - 0.005)).MakeVariable()
    made = blade(cleft)
    distance = made.distance(advance)(x)
    rest = distance.Diff(advance) + ngs.InnerProduct(distance.Diff(x), made.moves(x, advance).Diff(advance))
    places = mesh(*(rng.uniform(0, 1, (3, 200)) * np.array([[0.01], [0.03], [0.01]])))
    assert np.abs(rest(places)).max() < 1e-9 < 0.9 < np.abs(distance.Diff(advance)(places)).max()


def test_columns_of_a_row_are_observables_with_gradients(rng):
    """A column and its observable are equal, and the observable has a gradient; the contact area is discontinuous."""
    body, blades, _ = pressed_between(spatula, ("top", "bottom"))
    row, asked = Observer(body, blades, "back")(0.0, 0.0, 1.0), retraction_observables(body, blades)
    names = {"opening", "area", "force", "pressure", "tip_pressure", "centre_pressure", "depth", "net_reaction"}
    assert set(asked) == names and {each.unit for each in asked.values()} == {"m", "m²", "N", "Pa"}
    assert len({each.name for each in asked.values()}) == len(asked)
    x = body.x
    dx = 1e-5 * rng.normal(size=len(x)) * (body.weights > 0) * body.is_u[: len(x)]
    for name, each in asked.items():
        assert each.value(body)[0] == getattr(row, name), name
        if name == "area":
            with pytest.raises(InputError, match="smoothed"):
                each.gradient(body)
            continue
        observed = each.on(body)

        def value(at, observed=observed):
            body.x = at
            return float(observed.value()[0])

        gradient = observed.gradient(np.ones(1))
        assert taylor(value, gradient, x, dx, 3, 0.1)[-1] == pytest.approx(2, abs=0.1) or value(x + dx) == (
            pytest.approx(value(x) + gradient @ dx, rel=1e-10)
        ), name  # an opening is linear
        body.x = x


@pytest.mark.slow
def test_pressures_of_a_retraction_are_data_of_a_model():
    """Derivative by the cortex's stiffness for an opening and a hold: Taylor rate 2, and a stiffer cortex has more pressure."""
    scene = Scene.shipped("idealised_fast")
    mesh = replace(scene.mesh, wall=8e-3, craniotomy=20e-3, largest=45e-3)
    model = RetractionModel.from_scene(replace(scene, mesh=mesh, tools=(replace(scene.tool, travel=1e-3),)))
    factor, press = ngs.Parameter(1.0), ToolMotion("press", (0.0, 1.0, 2.0), (0.0, 5e-4, 5e-4))
    run = model.run(press, materials=model.scaled_materials({"cortex": factor}))
    asked = retraction_observables(run.problem, model.blades)
    seen = [asked[name] for name in ("pressure", "tip_pressure", "force", "net_reaction")]
    of = RunModel(run.problem, run.motion, [0.0, 0.05, 0.3, 1.0, 2.0], {"cortex": factor}, seen, [1.0, 2.0])
    theta = of.theta
    there = of.evaluate(theta)
    rows = there.data
    assert rows[:, 2] == pytest.approx(rows[:, 3], rel=1e-6)  # the blade's force and the tissue's, which balance
    w = np.array([[0.3], [1.0]]) / np.abs(rows).max(axis=0)
    gradient = there.gradient(w)
    assert np.all(there.jvp(np.ones(1)) > 0) and np.sum(w * there.jvp(np.ones(1))) == pytest.approx(gradient[0])
    rates = taylor(lambda at: float(np.sum(w * of.evaluate(at).data)), gradient, theta, np.ones(1), 3, 0.04)
    assert rates == pytest.approx(2, abs=0.1), rates
