"""From a file to a mesh in a file: a raw scan of a head, and labels with faults, by every route."""

import json
from dataclasses import replace
from pathlib import Path

import nibabel
import numpy as np
import pytest
from colin import colin27, dice
from phantoms import nested

from ngbrain.cli.mesh import summary
from ngbrain.errors import InputError
from ngbrain.image import mni152
from ngbrain.image.labelling import label_tissues
from ngbrain.image.read.label_map import LabelMap
from ngbrain.image.read.nifti import resample_labels, write_nifti
from ngbrain.image.read.volume import Volume
from ngbrain.io import load
from ngbrain.io.foreign import read_mesh
from ngbrain.mesh.geometry.sizing import RadialSizeField
from ngbrain.mesh.quality import volumes_ml
from ngbrain.mesh.routes.registry import ROUTES
from ngbrain.report.pages import anatomy
from ngbrain.workflows.mesh_head import write_subject
from ngbrain.workflows.subject import Subject


@pytest.mark.parametrize("route", ROUTES)
def test_labels_with_islands_and_holes_by_every_route(route, tmp_path):
    clean = nested((26.0, 19.0, 9.0))
    data = clean.volume.data.astype(np.uint8)
    data[2, 2, 2], data[-3, 4, 4] = 1, 2  # islands in the air
    middle = len(data) // 2
    data[middle + 14, middle, middle] = 0  # a hole
    nibabel.save(nibabel.Nifti1Image(data, np.diag([1e3, 1e3, 1e3, 1]) @ clean.volume.affine), tmp_path / "labels.nii")
    subject = Subject.from_labels(tmp_path / "labels.nii", {1: "grey", 2: "white", 3: "ventricles"})
    result = write_subject(subject, tmp_path / f"{route}.msh", route, RadialSizeField(3e-3, 3e-3))
    made = result.elements
    assert result["relabelled_voxels"] == 3 and result.usable and result.value == pytest.approx(volumes_ml(made))
    assert repr(result).startswith(f"HeadMesh: {next(iter(result.value))} ") and f"{len(made.tets)} tetrahedra" in repr(
        result
    )
    assert {line.get_label() for line in result.plot().axes[0].lines} <= set(made.regions)
    assert result["topology"] == {
        "grey": {"pieces": 1, "tunnels": 0, "cavities": 1},
        "white": {"pieces": 1, "tunnels": 0, "cavities": 1},
        "ventricles": {"pieces": 1, "tunnels": 0, "cavities": 0},
    }
    wanted = clean.volumes_ml()
    assert sum(volumes_ml(made).values()) == pytest.approx(sum(wanted.values()), rel=0.01)
    small = 0.05 if route == "lattice" else 0.02  # a lattice loses some of a ball of three elements' radius
    assert volumes_ml(made)["ventricles"] == pytest.approx(wanted["ventricles"], rel=small)
    back = read_mesh(tmp_path / f"{route}.msh")
    assert volumes_ml(back) == pytest.approx(volumes_ml(made), rel=1e-6) and set(back.boundaries) == set(
        made.boundaries
    )
    quality = json.loads((tmp_path / "result.json").read_text())["quality"]
    assert quality["min_dihedral_deg"] > (8 if route != "conforming" else 3)
    assert quality["fraction_radius_ratio_below_0_1"] <= (1e-4 if route == "lattice" else 1e-3)
    assert quality["min_jacobian"] > 0


def told(names, tmp_path, inner=8.0, **change):
    labels = nested((20.0, 15.0, inner), names)
    subject = Subject(labels, None, labels.volume.affine, labels.volume.data.shape, "labels")
    return write_subject(subject, tmp_path / "head.vtkhdf", **({"size": RadialSizeField(6e-3, 6e-3)} | change)).data


def test_a_result_says_which_regions_a_hull_has_not_and_which_are_off(tmp_path):
    result = told(("brain", "white", "ventricles"), tmp_path)
    assert result["regions"]["brain"]["volume_ml"] == pytest.approx(
        result["regions"]["brain"]["label_volume_ml"], rel=0.01
    )
    assert "ventricles" not in result["left_out"] and result["checks"] == {"volume_errors": {}, "changed_ml": {}}
    assert result["repairs"] == []
    labels = nested((20.0, 15.0))
    points = labels.volume.to_world(np.argwhere(labels.volume.data >= 0))
    beside = np.linalg.norm(points - [0, 0, 18e-3], axis=1).reshape(labels.volume.data.shape) < 3e-3
    data = np.where(beside & (labels.volume.data > 0), 3, labels.volume.data)
    subject = Subject(
        LabelMap(Volume(data, labels.volume.affine), {1: "grey", 2: "white", 3: "ventricles"}),
        None, labels.volume.affine, data.shape, "labels",
    )  # fmt: skip
    result = write_subject(subject, tmp_path / "head.vtkhdf", size=RadialSizeField(6e-3, 6e-3))
    assert "ventricles, too thin or too close" in result["left_out"]
    (repair,) = result["repairs"]
    assert (repair["region"], repair["kind"]) == ("ventricles", "left out")
    assert repair["ml"] == pytest.approx(1e-3 * (data == 3).sum()) and repair["at_mm"][2] == pytest.approx(18, abs=1.0)
    assert result["checks"]["changed_ml"] == {"ventricles": pytest.approx(repair["ml"])}
    assert not result.usable and "ventricles differs from the labels" in result.reasons[0]
    result = told(("grey", "white", "ventricles"), tmp_path, route="lattice", size=RadialSizeField(13e-3, 13e-3))
    assert max(abs(error) for error in result["checks"]["volume_errors"].values()) > 0.1


@pytest.mark.slow
def test_the_contrast_of_a_scan_is_in_the_result_and_on_its_page(tmp_path):
    labels = nested((20.0, 15.0, 8.0))
    without = Subject(labels, None, labels.volume.affine, labels.volume.data.shape, "labels")
    for subject, number in ((without, None), (replace(without, contrast=2.43), 2.43)):
        result = write_subject(subject, tmp_path / "head.vtkhdf", size=RadialSizeField(6e-3, 6e-3))
        made = result.elements
        assert json.loads((tmp_path / "result.json").read_text()).get("grey_white_contrast") == number
        page = anatomy.build(tmp_path / "report.html", result.data, made, labels, None, np.zeros(3)).read_text(
            encoding="utf-8"
        )
        said = "grey and white matter differ by 2.4 times" in "".join(summary(result)), "2.4 times the spread" in page
        assert said == (number is not None,) * 2


def test_output_is_tried_before_the_work(tmp_path):
    (tmp_path / "head.vtkhdf").mkdir()
    with pytest.raises(InputError, match=r"-o is '.*head.vtkhdf'; wanted: a file, not a folder"):
        told(("grey", "white", "ventricles"), tmp_path)
    with pytest.raises(OSError, match=r"(?i)no such|not permitted|read-only|permission"):
        told(("grey", "white", "ventricles"), Path("/proc"))
    result = told(("grey", "white", "ventricles"), tmp_path / "new")
    assert result["files"][0] == "head.vtkhdf"


def test_the_suffix_may_be_in_capitals(tmp_path):
    labels = nested((20.0, 15.0, 8.0))
    subject = Subject(labels, None, labels.volume.affine, labels.volume.data.shape, "labels")
    write_subject(subject, tmp_path / "HEAD.VTKHDF", size=RadialSizeField(6e-3, 6e-3))
    assert load(tmp_path / "HEAD.VTKHDF").mesh.ne > 100 and (tmp_path / "HEAD_labels.nii.gz").exists()


def test_islands_alone_are_no_head(tmp_path):
    data = np.zeros((9, 9, 9), np.uint8)
    data[4, 4, 4] = 1
    subject = Subject(LabelMap(Volume(data, np.diag([1e-3] * 3 + [1])), {1: "grey"}), None, np.eye(4), (9, 9, 9), "dot")
    with pytest.raises(InputError, match="labels is 1 voxels in islands, which are left out; wanted: a head"):
        write_subject(subject, tmp_path / "new" / "head.vtkhdf")
    assert not (tmp_path / "new").exists()


@pytest.mark.slow
def test_an_atlas_of_one_head_in_another(tmp_path):
    head = Subject.from_scan(colin27().source)
    data = np.ascontiguousarray(head.labels.volume.data.astype(np.uint8))
    write_nifti(
        tmp_path / "atlas.nii.gz", resample_labels(Volume(data, head.labels.volume.affine), head.affine, head.shape)
    )
    scan = mni152()
    image = nibabel.Nifti1Image(scan.volume.data, np.diag([1e3, 1e3, 1e3, 1]) @ scan.volume.affine)
    image.header.set_xyzt_units("mm")
    nibabel.save(image, tmp_path / "t1.nii.gz")
    found = Subject.from_atlas(tmp_path / "t1.nii.gz", tmp_path / "atlas.nii.gz", colin27().source, "ngbrain").labels
    truth = label_tissues(scan).volume.data
    scores = [dice(found.volume.data == number, truth == number) for number in (2, 3, 4)]
    print(np.round(scores, 3))
    assert min(scores[:2]) > 0.78 and scores[2] > 0.86


@pytest.mark.slow
@pytest.mark.parametrize("route", ROUTES)
def test_a_raw_scan_with_its_skull_by_every_route(route, tmp_path):
    subject = Subject.from_scan(colin27().source)
    result = write_subject(subject, tmp_path / "head.vtkhdf", route, RadialSizeField(5e-3, 5e-3))
    made = result.elements
    print(result["regions"], result["quality"], result["time_s"])
    for name, region in result["regions"].items():
        bound = 0.12 if name == "csf" else 0.02
        assert region["volume_ml"] == pytest.approx(region["label_volume_ml"], rel=bound)
    image = nibabel.load(tmp_path / "head_labels.nii.gz")
    assert image.shape == subject.shape and 1e3 * subject.affine[:3] == pytest.approx(image.affine[:3], abs=1e-3)
    assert 1700 < sum(volumes_ml(made).values()) < 2000
    assert result["quality"]["min_dihedral_deg"] > (8 if route != "conforming" else 3)


@pytest.mark.slow
def test_a_raw_scan_with_its_structures(tmp_path):
    subject = Subject.from_structures(colin27().source)
    result = write_subject(subject, tmp_path / "head.vtkhdf", "lattice", RadialSizeField(5e-3, 5e-3))
    made = result.elements
    print(result["regions"], result["quality"], result["time_s"])
    for name, region in result["regions"].items():
        bound = 0.12 if name == "csf" else 0.03
        assert region["volume_ml"] == pytest.approx(region["label_volume_ml"], rel=bound), name
    mesh = made.mesh()
    assert {"grey_left", "white_right", "brain_stem", "deep_grey_left", "corpus_callosum"} <= set(made.regions)
    assert mesh.Materials("white.*").Mask().NumSet() == 3
    assert mesh.Boundaries("(grey|white)_(left|right)_(grey|white)_cerebellum").Mask().NumSet() >= 1
