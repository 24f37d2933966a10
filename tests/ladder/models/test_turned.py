"""A body without any symmetry, turned or mirrored with everything that belongs to it, has the same answers, turned with it."""

from dataclasses import replace
from itertools import permutations, product

import netgen.meshing as meshing
import netgen.occ as occ
import numpy as np
import pytest

pytest.importorskip("nibabel")

from ngbrain.image.read.nifti import write_nifti
from ngbrain.image.read.volume import Volume
from ngbrain.ladder.axes import axes_of, cheapest
from ngbrain.ladder.models.hierarchy import ModelHierarchy
from ngbrain.scene import DisplacementBC, Geometry, Gravity, MeshSize, Quantity, Scene, Time, Tissue, Traction

TURNS = [
    np.eye(3)[list(order)] * signs
    for order in permutations(range(3))
    for signs in np.array(list(product((1, -1), repeat=3)))
]
ROTATIONS = [R for R in TURNS if np.linalg.det(R) > 0]
MIRROR = np.diag([-1.0, 1.0, 1.0])
PLACE, AXIS, POINT = np.array([0.004, -0.003, 0.006]), np.array([0.48, 0.6, 0.64]), np.array([0.009, 0.011, 0.012])
"""Digits of few places: a mesh file keeps twelve, and the same ones when axes are only permuted and turned about."""


@pytest.fixture(scope="module")
def body():
    """A block, off the middle, with a patch on its top that is off the middle too: points, elements and names."""
    block = occ.Box(occ.Pnt(0, 0, 0), occ.Pnt(0.02, 0.024, 0.016))
    for axis, low, high in ((occ.X, "left", "right"), (occ.Y, "front", "back"), (occ.Z, "bottom", "top")):
        block.faces.Min(axis).name, block.faces.Max(axis).name = low, high
    patch = occ.Box(occ.Pnt(0.003, 0.004, 0.012), occ.Pnt(0.012, 0.012, 0.016))
    patch.faces.Max(occ.Z).name = "patch"
    rest = block - patch
    for part in (rest, patch):
        part.mat("tissue")
    made = occ.OCCGeometry(occ.Glue([rest, patch])).GenerateMesh(maxh=0.014, parallel_meshing=False)
    names = {i: made.GetBCName(i) for i in range(len(made.FaceDescriptors()))}
    faces = [(face.surfnr, face.domin, face.domout) for face in made.FaceDescriptors()]  # they go with their mesh
    points = made.Coordinates().round(9)
    return points, made.Elements3D().NumPy().copy(), made.Elements2D().NumPy().copy(), faces, names


def turned(body, R, folder):
    """The scene with everything turned by R: mesh node by node, vectors, the fibre, the map by its affine, the questions."""
    points, solids, sides, faces, names = body
    mesh = meshing.Mesh(dim=3)
    mesh.AddPoints(np.ascontiguousarray((points - PLACE) @ R.T))
    mesh.SetMaterial(1, "tissue")
    tets, triangles = solids["nodes"][:, :4].copy(), sides["nodes"][:, :3].copy()
    if np.linalg.det(R) < 0:  # Netgen's orientation
        tets[:, [0, 1]], triangles[:, [0, 1]] = tets[:, [1, 0]], triangles[:, [1, 0]]
    mesh.AddElements(3, 1, np.ascontiguousarray(tets, np.int32), base=1)
    for i, (surface, within, without) in enumerate(faces):
        mesh.Add(meshing.FaceDescriptor(surfnr=surface, domin=within, domout=without, bc=i + 1))
        mesh.SetBCName(i, names[i])
    mesh.AddElements(2, 1, np.ascontiguousarray(triangles, np.int32), base=1)
    mesh.Elements2D().NumPy()["index"] = sides["index"]
    folder.mkdir()
    mesh.Save(str(folder / "body.vol"))
    index = np.indices((8, 9, 7)).reshape(3, -1).T
    values = (1000 + index @ [60.0, -40.0, 90.0]).reshape(8, 9, 7)
    affine = np.diag([0.004, 0.004, 0.004, 1.0])
    affine[:3, 3] = [-0.004, -0.004, -0.004]
    move = np.eye(4)
    move[:3, :3], move[:3, 3] = R, -R @ PLACE
    write_nifti(folder / "map.nii", Volume(values, move @ affine))
    stuff = Tissue(
        mu=(1000.0,),
        poissons_ratio=0.3,
        fibre_stiffness=300.0,
        fibre_exponent=2.0,
        fibre=tuple(R @ AXIS),
        shear_modulus_map=str(folder / "map.nii"),
        density=1000.0,
    )
    vector = lambda *v: tuple((R @ np.array(v)).tolist())  # noqa: E731
    return Scene(
        mesh=MeshSize(largest=0.015),
        gravity=Gravity(acceleration=vector(*(9.81 * np.array((0.36, 0.48, -0.8))))),
        geometry=Geometry(unit="m", kind="mesh", file=str(folder / "body.vol")),
        tissues=(stuff,),
        displacement_bcs=(
            DisplacementBC(boundary="bottom"),
            DisplacementBC(boundary="right", value=vector(1e-3, -5e-4, 2e-4)),
        ),
        tractions=(Traction(boundary="patch", value=vector(30.0, -20.0, -80.0)),),
        time=Time(),
        quantities=(
            Quantity(name="force", boundary="bottom", direction=vector(0.36, 0.48, 0.8)),
            Quantity(name="force", boundary="right", direction=vector(0, 0, 1)),
            Quantity(name="displacement", point=vector(*(POINT - PLACE)), direction=vector(0.6, 0, 0.8)),
            Quantity(name="strain", percentile=80.0),
        ),
    )


def answers(scene, **levels):
    model = cheapest(axes_of(scene)) | levels
    return ModelHierarchy(scene).solve(model).answers


RUNGS = {
    "one tissue": {},
    "fibres": {"fibres": "all"},
    "map": {"fibres": "all", "tissue": "map"},
    "pressures": {"fibres": "all", "pressure": "unknown", "tissue": "map"},
    "finite": {"fibres": "all", "strain": "finite", "tissue": "map"},
}

FEW = {name: RUNGS[name] for name in ("map", "pressures")}
"""Cheap ones."""


@pytest.mark.parametrize("number", [10])
def test_a_turned_body_has_turned_answers(body, tmp_path, number):
    first, other = turned(body, np.eye(3), tmp_path / "a"), turned(body, ROTATIONS[number], tmp_path / "b")
    for name, levels in FEW.items():
        np.testing.assert_allclose(answers(other, **levels), answers(first, **levels), rtol=1e-8, err_msg=name)


@pytest.mark.parametrize("number", [11])
def test_a_mirrored_body_has_mirrored_answers(body, tmp_path, number):
    first = turned(body, np.eye(3), tmp_path / "a")
    other = turned(body, MIRROR @ ROTATIONS[number], tmp_path / "b")
    for name, levels in FEW.items():
        np.testing.assert_allclose(answers(other, **levels), answers(first, **levels), rtol=1e-8, err_msg=name)


@pytest.mark.slow
@pytest.mark.parametrize("number", range(24))
def test_all_turns(body, tmp_path, number):
    first, other = turned(body, np.eye(3), tmp_path / "a"), turned(body, ROTATIONS[number], tmp_path / "b")
    for name, levels in RUNGS.items():
        for order in ("1", "2"):
            found, wanted = (answers(scene, **levels, order=order) for scene in (other, first))
            np.testing.assert_allclose(found, wanted, rtol=1e-8, err_msg=f"{name}, order {order}")


@pytest.mark.slow
def test_nothing_that_turns_is_without_effect(body, tmp_path):
    """Each mapping counts: with one of them left out the answers differ."""
    R = ROTATIONS[10]
    right = turned(body, R, tmp_path / "b")
    first = answers(turned(body, np.eye(3), tmp_path / "a"), **RUNGS["map"])
    assert len(ROTATIONS) == 24
    unturned = turned(body, np.eye(3), tmp_path / "c")
    parts = {
        "fibre": replace(right, tissues=(replace(right.tissues[0], fibre=unturned.tissues[0].fibre),)),
        "map": replace(
            right, tissues=(replace(right.tissues[0], shear_modulus_map=unturned.tissues[0].shear_modulus_map),)
        ),
        "traction": replace(right, tractions=unturned.tractions),
        "gravity": replace(right, gravity=unturned.gravity),
        "displacement": replace(right, displacement_bcs=unturned.displacement_bcs),
        "quantity": replace(right, quantities=unturned.quantities[:2] + right.quantities[2:]),
    }
    for name, wrong in parts.items():
        try:
            found = answers(wrong, **RUNGS["map"])
        except Exception as error:
            assert name == "map" and "image that ends" in str(error)
            continue
        assert np.abs(found / first - 1).max() > 1e-4, name
