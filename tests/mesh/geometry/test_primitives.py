"""The idealised head: names, volumes against closed forms, exact planes, the same bits twice, refusals."""

import hashlib

import ngsolve as ngs
import numpy as np
import pytest

from ngbrain.errors import InputError
from ngbrain.mesh import Sizes, block, cleft_to, idealised_head, load
from ngbrain.mesh.geometry.primitives import (
    FREE_MARGIN,
    NOTCH_CENTRE,
    NOTCH_RADIUS,
    SEMI_AXES,
    SHEETS,
    TENTORIUM_HEIGHT,
    VENTRICLE_SEMI_AXES,
)

TARGET = np.array([17.0, 5.9, 26.2]) * 1e-3
COARSE = Sizes(4e-3, 10e-3, 24e-3)


@pytest.fixture(scope="module")
def opened():
    cleft = cleft_to(TARGET)
    return cleft, idealised_head(cleft, sizes=COARSE)


def volume(mesh, pattern):
    return ngs.Integrate(ngs.CF(1), mesh, definedon=mesh.Materials(pattern))


def area(mesh, pattern):
    return ngs.Integrate(ngs.CF(1), mesh, definedon=mesh.Boundaries(pattern))


def test_names(opened):
    _, mesh = opened
    assert set(mesh.GetMaterials()) == {"cortex", "white", "ventricle_left", "ventricle_right"}
    walls = {"wall_plus", "wall_minus", "end_plus", "end_minus", "floor"}
    assert set(mesh.GetBoundaries()) == walls | {"skull", "craniotomy", "ventricle_wall", "inside"}


def test_volumes_are_those_of_ellipsoids_less_the_slot(opened):
    cleft, mesh = opened
    ellipsoid = 4 / 3 * np.pi * np.prod(SEMI_AXES)
    slot = cleft.opening * cleft.width * cleft.depth
    assert volume(mesh, ".*") == pytest.approx(ellipsoid - slot, rel=2e-3)
    for side in ("left", "right"):
        ventricle = 4 / 3 * np.pi * np.prod(VENTRICLE_SEMI_AXES)
        # Some 80 elements each: their wall is pulled in where they would fold.
        assert volume(mesh, f"ventricle_{side}") == pytest.approx(ventricle, rel=3e-2)


def test_the_cleft_has_exact_planes_and_the_depth_asked_for(opened):
    cleft, mesh = opened
    assert cleft.depth == pytest.approx(30e-3, abs=1e-4)
    assert area(mesh, "floor") == pytest.approx(4e-3 * 12e-3, rel=1e-9)
    for vertex in {v for el in mesh.Boundaries("wall_plus").Elements() for v in el.vertices}:
        a, b, c = cleft.coordinates(np.array([mesh[vertex].point]))[0]
        assert a == pytest.approx(2e-3, abs=1e-12) and abs(b) < 6.0001e-3 and c > -1e-9
    assert area(mesh, "wall_plus") == pytest.approx(area(mesh, "wall_minus"), rel=1e-2)


def segment(a, b, height):
    """Area of the part of an ellipse above a height along its semi-axis b."""
    t = height / b
    return a * b * (np.pi / 2 - t * np.sqrt(1 - t * t) - np.arcsin(t))


def sheet_areas():
    """Closed forms: an ellipse minus the inner one, both above the tentorium; a part of an ellipse minus half a disc."""
    x, y, z = SEMI_AXES
    falx = segment(y, z, TENTORIUM_HEIGHT) - segment(FREE_MARGIN * y, FREE_MARGIN * z, TENTORIUM_HEIGHT)
    cut = np.sqrt(1 - (TENTORIUM_HEIGHT / z) ** 2)
    return falx, segment(cut * x, cut * y, -NOTCH_CENTRE) - np.pi * NOTCH_RADIUS**2 / 2


@pytest.mark.parametrize("sheets", [("falx",), ("tentorium",), SHEETS])
def test_falx_and_tentorium_have_the_areas_of_closed_forms(sheets):
    mesh = idealised_head(sizes=COARSE, sheets=sheets)
    assert set(mesh.GetBoundaries()) == {"skull", "ventricle_wall", "inside", *sheets}
    assert set(mesh.GetMaterials()) == {"cortex", "white", "ventricle_left", "ventricle_right"}
    for name, exact in zip(SHEETS, sheet_areas(), strict=True):
        if name in sheets:
            assert area(mesh, name) == pytest.approx(exact, rel=2e-3)
    assert volume(mesh, ".*") == pytest.approx(4 / 3 * np.pi * np.prod(SEMI_AXES), rel=2e-3)


def test_sheets_lie_in_their_planes_with_tissue_on_both_sides():
    mesh = idealised_head(sizes=COARSE, sheets=SHEETS)
    for name, axis, level in (("falx", 0, 0.0), ("tentorium", 2, TENTORIUM_HEIGHT)):
        faces = [element.faces[0] for element in mesh.Boundaries(name).Elements()]
        places = np.array([mesh[v].point for element in mesh.Boundaries(name).Elements() for v in element.vertices])
        assert np.abs(places[:, axis] - level).max() < 1e-9
        assert all(len(mesh[face].elements) == 2 for face in faces)


@pytest.mark.slow
def test_a_cleft_cuts_the_falx():
    cleft = cleft_to(1e-3 * np.array([0.0, 10.0, 45.0]), approach=np.array([0, 0, 1.0]), across=np.array([0, 1.0, 0]))
    mesh = idealised_head(cleft, sizes=COARSE, sheets=("falx",))
    falx, _ = sheet_areas()
    assert area(mesh, "falx") < falx - 0.9 * 4e-3 * cleft.depth
    assert area(mesh, "craniotomy") > 0


def test_unknown_sheets_are_refused():
    with pytest.raises(InputError, match="sheets is 'flax'; wanted: did you mean 'falx'"):
        idealised_head(sheets=("flax",))


def test_the_craniotomy_is_a_disc_of_40_mm(opened):
    # The disc less the slot; the surface bulges, so its area is a little more.
    _, mesh = opened
    assert 1.0 < area(mesh, "craniotomy") / (np.pi * 20e-3**2 - 48e-6) < 1.06


def test_no_element_is_inverted_at_its_corners(opened):
    _, mesh = opened
    points = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (0.5, 0, 0), (0, 0.5, 0), (0, 0, 0.5)]
    points += [(0.5, 0.5, 0), (0.5, 0, 0.5), (0, 0.5, 0.5)]
    at = mesh.MapToAllElements(ngs.IntegrationRule(points, [0.0] * len(points)), ngs.VOL)
    values = np.array(ngs.Det(ngs.specialcf.JacobianMatrix(3))(at)).reshape(mesh.ne, -1)
    assert np.min(values.min(axis=1) / values.max(axis=1)) > 0.05


def test_the_surface_is_curved(opened):
    # The root mean square distance to the ellipsoid; that of straight elements is 1 mm.
    _, mesh = opened
    level = sum((c / a) ** 2 for c, a in zip((ngs.x, ngs.y, ngs.z), SEMI_AXES, strict=True)) - 1
    surface = mesh.Boundaries("skull|craniotomy")
    distance = np.sqrt(ngs.Integrate(level**2, mesh, definedon=surface) / area(mesh, "skull|craniotomy")) * 0.07 / 2
    assert distance < 1e-4


def test_the_same_shape_gives_the_same_bits(opened):
    cleft, mesh = opened

    def digest(m):
        return hashlib.sha256(np.array([v.point for v in m.vertices]).tobytes()).hexdigest()

    assert digest(idealised_head(cleft, sizes=COARSE)) == digest(mesh)


def test_the_shortest_way_out_is_normal_to_the_surface():
    cleft = cleft_to(TARGET)
    normal = cleft.entry / SEMI_AXES**2
    assert np.allclose(cleft.out, normal / np.linalg.norm(normal), atol=1e-8)
    for other in (np.array([0.0, 0.0, 40e-3]), np.array([-30e-3, 20e-3, 20e-3])):
        entry = cleft_to(other).entry
        assert np.sum((entry / SEMI_AXES) ** 2) == pytest.approx(1.0, abs=1e-9)


def test_an_approach_of_ones_own():
    cleft = cleft_to(TARGET, approach=np.array([0, 0, 2.0]), across=np.array([0, 1.0, 0.3]))
    assert np.allclose(cleft.out, [0, 0, 1]) and np.allclose(cleft.across, [0, 1, 0])


@pytest.mark.parametrize(
    ("target", "message"), [((0.0, 0.0, 0.07), "inside the brain"), ((0.014, 0.0, 0.006), "not in a ventricle")]
)
def test_targets_outside_the_tissue_are_refused(target, message):
    with pytest.raises(InputError, match=message):
        cleft_to(np.array(target))


@pytest.mark.parametrize(
    ("target", "approach"),
    [
        ((14.0, 0.0, -10.0), (0, 0, 1)),  # through the middle
        ((14.0, 0.0, 17.0), (1, 0, 0)),  # with an edge
        ((0.0, -30.0, 0.0), (0.4, 1, 0.1)),
    ],
)
def test_a_slot_through_a_ventricle_is_refused(target, approach):
    cleft = cleft_to(1e-3 * np.array(target), approach=np.array(approach, float))
    with pytest.raises(InputError, match=r"cleft.target_mm is \(.*\) mm; wanted: .* spare the ventricles"):
        idealised_head(cleft, sizes=COARSE)


def test_a_slot_beside_a_ventricle_is_not():
    cleft = cleft_to(1e-3 * np.array([14.0, 0.0, 16.1]), approach=np.array([0, 0, 1.0]))
    assert volume(idealised_head(cleft, sizes=COARSE), "ventricle_right") > 0


def test_a_deep_cleft_leaves_the_skull_its_name():
    cleft = cleft_to(1e-3 * np.array([0.0, 0.0, -40.0]), approach=np.array([0, 0, 1.0]))
    mesh = idealised_head(cleft, sizes=COARSE)
    assert area(mesh, "craniotomy") < 1.1 * np.pi * 20e-3**2 < area(mesh, "skull")


@pytest.mark.parametrize(
    ("far", "grading", "why"), [(60e-3, 1.0, "Netgen gives up"), (50e-3, 0.95, r"1\.[0-9] % of the brain is cut off")]
)
def test_sizes_that_are_too_large_are_refused(far, grading, why):
    less = "less, or smaller mesh.craniotomy_size_mm or mesh.wall_size_mm"
    message = f"mesh.max_size_mm is {1e3 * far:g}, such that {why}.*; wanted: {less}$"
    with pytest.raises(InputError, match=message):
        idealised_head(sizes=Sizes(far=far, grading=grading))


def test_shipped_meshes():
    assert volume(load("block"), "tissue") == pytest.approx(0.06 * 0.06 * 0.04)
    head = load("idealised_head")
    assert volume(head, ".*") == pytest.approx(4 / 3 * np.pi * np.prod(SEMI_AXES), rel=2e-3)
    assert head.nv == len({v for el in head.Elements() for v in el.vertices})
    with pytest.raises(InputError, match="idealised_head"):
        load("idealized_head")


def test_distance_to_walls():
    cleft = cleft_to(TARGET)
    on_wall = cleft.target + 0.002 * cleft.across + 0.01 * cleft.out
    points = np.array(
        [on_wall, on_wall + 5e-3 * cleft.across, on_wall + 9e-3 * cleft.along, on_wall - 14e-3 * cleft.out]
    )
    assert np.allclose(cleft.distance_to_walls(points), [0, 5e-3, 3e-3, 4e-3], atol=1e-12)


def test_block_size():
    assert volume(block((0.01, 0.02, 0.03), 0.01), "tissue") == pytest.approx(6e-6)
