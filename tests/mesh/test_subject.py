"""From a file to a mesh in a file: a raw scan of a head, and labels with faults, by every route."""

import json

import nibabel
import numpy as np
import pytest
from colin import colin27
from phantoms import nested

from ngbrain.io.exchange import read_mesh
from ngbrain.mesh.grading import Graded
from ngbrain.mesh.quality import volumes_ml
from ngbrain.mesh.routes import ROUTES
from ngbrain.mesh.subject import Subject, write_subject


@pytest.mark.parametrize("route", ROUTES)
def test_labels_with_islands_and_holes_by_every_route(route, tmp_path):
    clean = nested((26.0, 19.0, 9.0))
    data = clean.volume.data.astype(np.uint8)
    data[2, 2, 2], data[-3, 4, 4] = 1, 2  # islands in the air
    middle = len(data) // 2
    data[middle + 14, middle, middle] = 0  # a hole
    nibabel.save(nibabel.Nifti1Image(data, np.diag([1e3, 1e3, 1e3, 1]) @ clean.volume.affine), tmp_path / "labels.nii")
    subject = Subject.of_labels(tmp_path / "labels.nii", {1: "grey", 2: "white", 3: "ventricles"})
    result, made = write_subject(subject, tmp_path / f"{route}.msh", route, Graded(3e-3, 3e-3))
    assert result["relabelled_voxels"] == 3
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


@pytest.mark.slow
@pytest.mark.parametrize("route", ROUTES)
def test_a_raw_scan_with_its_skull_by_every_route(route, tmp_path):
    subject = Subject.of_scan(colin27().source)
    result, made = write_subject(subject, tmp_path / "head.vtkhdf", route, Graded(5e-3, 5e-3))
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
    subject = Subject.of_structures(colin27().source)
    result, made = write_subject(subject, tmp_path / "head.vtkhdf", "lattice", Graded(5e-3, 5e-3))
    print(result["regions"], result["quality"], result["time_s"])
    for name, region in result["regions"].items():
        bound = 0.12 if name == "csf" else 0.03
        assert region["volume_ml"] == pytest.approx(region["label_volume_ml"], rel=bound), name
    mesh = made.mesh()
    assert {"grey_left", "white_right", "brain_stem", "deep_grey_left", "corpus_callosum"} <= set(made.regions)
    assert mesh.Materials("white.*").Mask().NumSet() == 3
    assert mesh.Boundaries("(grey|white)_(left|right)_(grey|white)_cerebellum").Mask().NumSet() >= 1
