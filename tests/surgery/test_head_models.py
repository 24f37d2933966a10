"""A head from a scan: agreement of the model with its labels, and refusals."""

from dataclasses import replace

import ngsolve as ngs
import nibabel
import numpy as np
import pytest
from resampled_scans import slanted, thick

from ngbrain.cli import main
from ngbrain.errors import InputError
from ngbrain.forward.common.material import Material
from ngbrain.forward.solid.problem import Problem
from ngbrain.image import Volume
from ngbrain.image.labelling import template_affine
from ngbrain.image.segment.tissue_classes import WHITE
from ngbrain.mesh import Sizes
from ngbrain.mesh.tet_mesh import centres
from ngbrain.scene import Scene
from ngbrain.surgery.head_models import ScannedHead, load_head, transfer_scene
from ngbrain.surgery.model import RetractionModel
from ngbrain.surgery.protocol_run import ProtocolRun


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("NGBRAIN_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(scope="module")
def model(cache):
    return RetractionModel.from_scene(Scene.shipped("demo_fast"))


def volume_ml(mesh, region):
    return 1e6 * ngs.Integrate(ngs.CF(1), mesh, definedon=mesh.Materials(region))


@pytest.mark.slow
def test_volumes_are_those_of_the_labels(model):
    told = model.head.describe(model.mesh)
    slot = 1e6 * model.cleft.opening * model.cleft.width * model.cleft.depth
    assert volume_ml(model.mesh, "brain") == pytest.approx(told["label_brain_ml"] - slot, rel=1e-3)
    assert volume_ml(model.mesh, "ventricles") == pytest.approx(told["label_volumes_ml"]["ventricle"], rel=1e-2)
    assert told["min_dihedral_deg"] > 3


@pytest.mark.slow
def test_the_template_lies_in_itself(model):
    place = template_affine(model.head.scan)
    corners = 0.08 * np.array(list(np.ndindex(2, 2, 2))) - [0.04, 0.06, 0.03]
    assert np.abs(corners @ place[:3, :3].T + place[:3, 3] - corners).max() < 1e-3


@pytest.mark.slow
def test_coarser_elements_elsewhere_leave_the_ventricles_as_they_are(model):
    # Where large triangles do not close around a horn, finer ones are tried: then coarser sizes gave more elements.
    where = model.scene.cleft
    other = model.head.open_cleft(model.cleft, where.craniotomy_diameter, Sizes(4e-3, 10e-3, 20e-3))
    assert other.ne > model.mesh.ne
    numbers = [sum(el.mat == "ventricle_wall" for el in mesh.Elements(ngs.BND)) for mesh in (model.mesh, other)]
    assert numbers[0] == numbers[1] > 200


@pytest.mark.slow
def test_tissues_are_the_labels_at_the_quadrature_points(model):
    shares = model.head.mixtures(model.mesh, 2)["brain"]
    white, grey = (share.vec.FV().NumPy() for share in (shares["white"], shares["grey"]))
    assert set(np.unique(white)) == {0.0, 1.0} and np.array_equal(grey, 1 - white)
    labels = model.head.labels.data
    inside = labels > 0
    assert ngs.Integrate(shares["white"] * ngs.dx("brain", intrules=shares["white"].space.GetIntegrationRules()),
                         model.mesh) * 1e6 == pytest.approx(1e-3 * np.sum(labels[inside] == WHITE), rel=0.05)  # fmt: skip


@pytest.mark.slow
def test_one_tissue_twice_is_that_tissue(model):
    # Both tissues alike: the mixture of constants must give the forces of the plain law.
    grey, _, fluid = model.scene.tissues
    same = replace(model.scene, tissues=(grey, replace(grey, region="white"), fluid))
    mixed = replace(model, scene=same).materials()
    plain = Material(grey.law(), grey.bulk, pointwise=0.2 * grey.initial_modulus)
    forces = []
    for material in (mixed["brain"], plain):
        body = Problem(
            model.mesh, {"brain": material, "ventricles": mixed["ventricles"]}, {"skull": 0}, element="P2/P1"
        )
        body.u.Set(0.02 * ngs.CF((ngs.y, ngs.z, ngs.x)))
        body.begin(0.5)
        forces.append(body.residual(body.x)[0])
    assert np.abs(forces[0]).max() > 0
    assert np.abs(forces[0] - forces[1]).max() < 1e-10 * np.abs(forces[1]).max()


@pytest.mark.slow
def test_the_first_push_of_the_blade(model):
    run = ProtocolRun(model, model.ramp("push"), None).run(until=0.2)
    row, body = run.rows[-1], run.transient.problem
    assert 0.2 <= row.t < 1 and row.force > 0 and row.net_reaction > 0 and row.gap < 0 < row.area
    assert row.balance < 1e-4 and row.min_det_F > 0.8
    moved = body.u(body.mesh.MapToAllElements({ngs.TET: body.history.rules[ngs.TET]}, ngs.VOL))
    assert 0 < row.opening < 2 * row.advance and 0 < np.abs(moved).max() < 2 * row.advance


def written(path, volume: Volume, turn=None):
    """A scan as a file in mm, its axes flipped and permuted by `turn`."""
    image = nibabel.Nifti1Image(volume.data, np.diag([1e3, 1e3, 1e3, 1]) @ volume.affine)
    image.header.set_xyzt_units("mm")
    nibabel.save(image if turn is None else image.as_reoriented(turn), path)
    return str(path)


@pytest.mark.slow
def test_a_flipped_copy_is_the_same_head_and_its_voxels_are_its_own(model, tmp_path):
    volume = model.head.scan.volume
    turn = np.array([[1, -1], [2, 1], [0, -1]])
    file = written(tmp_path / "turned.nii.gz", volume, turn)
    copy = load_head(replace(model.scene.geometry, kind="scan", image=file))
    assert isinstance(copy, ScannedHead) and np.array_equal(copy.labels.data, model.head.labels.data)
    target = np.array(model.scene.cleft.target)
    voxel = Volume(volume.data, copy.scan.file_affine).to_voxels(target[None])[0]
    cleft = replace(model.scene.cleft, target=None, voxel=tuple(voxel))
    assert np.allclose(cleft.slot(copy).target, target, atol=1e-9)
    moved = transfer_scene(model.scene, file)
    assert np.allclose(moved.cleft.target, target, atol=1e-3) and "turned.nii.gz" in moved.title


@pytest.mark.slow
def test_the_cleft_goes_along_with_a_head_that_nods(model, tmp_path):
    """A nod of 12°, as occurs in a scanner; centre and extent along the axes alone would misplace the cleft by 6 mm or more."""
    volume, nod = model.head.scan.volume, np.eye(4)
    nod[1:3, 1:3] = [[np.cos(0.21), -np.sin(0.21)], [np.sin(0.21), np.cos(0.21)]]
    file = written(tmp_path / "nodding.nii.gz", Volume(volume.data, nod @ volume.affine))
    target = np.array(model.scene.cleft.target)
    wanted = (nod @ [*target, 1.0])[:3]
    assert np.linalg.norm(transfer_scene(model.scene, file).cleft.target - wanted) < 2e-3
    brain = np.argwhere(model.head.labels.data > 0)
    there, here = (Volume(volume.data, affine).to_world(brain) for affine in (nod @ volume.affine, volume.affine))
    naive = there.mean(axis=0) + there.std(axis=0) * (target - here.mean(axis=0)) / here.std(axis=0)
    assert np.linalg.norm(naive - wanted) > 6e-3


@pytest.mark.slow
@pytest.mark.parametrize("regrid", [slanted, thick])
def test_a_copy_on_another_grid_gives_the_same_model(model, regrid, tmp_path):
    file = written(tmp_path / "copy.nii.gz", regrid(model.head.scan.volume))
    copy = RetractionModel.from_scene(
        replace(model.scene, geometry=replace(model.scene.geometry, kind="scan", image=file))
    )
    one, other = model.head.describe(model.mesh), copy.head.describe(copy.mesh)
    print(one, other)
    assert other["label_brain_ml"] == pytest.approx(one["label_brain_ml"], rel=5e-3)
    for name, part in (("grey", 0.05), ("white", 0.05), ("ventricle", 0.04)):
        assert other["label_volumes_ml"][name] == pytest.approx(one["label_volumes_ml"][name], rel=part), name
    assert np.allclose(copy.cleft.target, model.cleft.target, atol=1e-9)
    assert copy.cleft.depth == pytest.approx(model.cleft.depth, abs=0.5e-3)
    assert copy.cleft.out @ model.cleft.out > np.cos(np.radians(3))
    # The skull of one lies on that of the other, and at most places they agree on what is there.
    skull = np.array([copy.mesh[v].point for v in _vertices(copy.mesh, "skull")])
    off = np.abs(model.head.outlines.brain(skull) - copy.head.outlines.brain(skull))
    print(f"skull off by {1e3 * off.mean():.2f} mm, at most {1e3 * off.max():.2f}")
    assert off.mean() < 0.2e-3 and off.max() < 1.5e-3
    places = centres(model.mesh)
    same = np.mean(_label(model.head, places) == _label(copy.head, places))
    print(f"the same tissue at {same:.3f} of the places")
    assert same > 0.95


def _vertices(mesh, boundary):
    return sorted({v for e in mesh.Boundaries(boundary).Elements() for v in e.vertices}, key=lambda v: v.nr)


def _label(head, points):
    at = np.round(head.labels.to_voxels(points)).astype(int)
    return head.labels.data[tuple(at.T)]


@pytest.mark.parametrize(
    ("target", "words"),
    [((0.0, 0.0, 0.2), "inside the brain"), ((0.0, 0.0, 0.1), "inside the brain"), (None, "not in a ventricle")],
)
@pytest.mark.slow
def test_targets_outside_the_tissue_are_refused(model, target, words):
    if target is None:
        ventricles = model.head.outlines.ventricles
        at = np.unravel_index(ventricles.values.argmin(), ventricles.values.shape)
        target = ventricles.origin + ventricles.spacing * np.array(at)
    with pytest.raises(InputError, match=rf"cleft\.target_mm is \(.*{words}"):
        model.head.cleft_to(np.array(target))


def test_a_bad_image_ends_with_one_line(tmp_path, capsys, cache):
    path = tmp_path / "noise.nii.gz"
    path.write_bytes(b"no picture")
    assert main(["demo", "--fast", "--image", str(path), "-q", "-o", str(tmp_path / "out")]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1 and "noise.nii.gz" in lines[0] and "NIfTI" in lines[0]
