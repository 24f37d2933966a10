"""The hull route on phantoms: volumes, names, sizes, sound elements, and labels that are not what they should be."""

from dataclasses import replace

import numpy as np
import pytest
from phantoms import MM, grid, nested, turned
from resampled_scans import rotation

from ngbrain.errors import InputError
from ngbrain.image.read.label_map import LabelMap
from ngbrain.image.read.volume import Volume
from ngbrain.mesh.geometry.sizing import RadialSizeField
from ngbrain.mesh.quality import Quality, volumes_ml
from ngbrain.mesh.routes.hull import hull, smooth_hull
from ngbrain.mesh.routes.registry import mesh_elements, min_jacobian, summarise_mesh
from ngbrain.mesh.surface.head_outlines import outlines
from ngbrain.mesh.transfer import voxelise

EVEN = RadialSizeField(7e-3, 7e-3)


@pytest.fixture(scope="module")
def labels():
    return nested()


@pytest.fixture(scope="module")
def made(labels):
    return hull(labels, EVEN).elements


def test_volumes_are_those_of_the_labels(labels, made):
    wanted = labels.volumes_ml()
    assert volumes_ml(made) == pytest.approx(
        {"brain": wanted["grey"] + wanted["white"], "ventricles": wanted["ventricles"]}
    )
    regions = summarise_mesh(made, labels)["regions"]
    assert regions["brain"]["label_volume_ml"] == pytest.approx(wanted["grey"] + wanted["white"])
    away = {
        name: np.linalg.norm(made.points[made.triangles[made.boundary == i]], axis=2)
        for i, name in enumerate(made.boundaries)
    }
    print({name: (r.min() / MM, r.max() / MM) for name, r in away.items()})
    assert away["skull"] == pytest.approx(40 * MM, abs=0.6 * MM)
    assert away["ventricle_wall"] == pytest.approx(12 * MM, abs=0.8 * MM)  # outside: triangles cut corners off a ball


def test_elements_are_sound_and_ngsolve_takes_them(made):
    quality = Quality.of(made).summary()
    print(quality)
    assert (made.volumes() > 0).all() and quality["min_dihedral_deg"] > 8
    assert quality["fraction_radius_ratio_below_0_1"] == 0
    mesh = made.mesh()
    assert set(mesh.GetMaterials()) == {"brain", "ventricles"} and min_jacobian(mesh) == pytest.approx(1)


def test_elements_are_fine_around_a_site(labels):
    site = np.array([0.025, 0.0, 0.0])
    graded = hull(labels, RadialSizeField(2.5e-3, 9e-3, tuple(site), radius=5e-3)).elements
    size = np.cbrt(8.49 * np.abs(graded.volumes()))
    away = np.linalg.norm(graded.points[graded.tets].mean(axis=1) - site, axis=1)
    near, far = size[away < 5e-3], size[away > 40e-3]
    print(len(graded.tets), "near", near.mean() / MM, "far", far.mean() / MM)
    assert 1.8e-3 < near.mean() < 3.6e-3 and far.mean() > 5e-3


def test_flat_elements_become_round(labels):
    # A point of a good mesh pushed almost into the face opposite.
    good = hull(labels, EVEN).elements
    inner = np.setdiff1d(good.tets.ravel(), good.triangles.ravel())[40]
    tet = good.tets[(good.tets == inner).any(axis=1)][0]
    to = good.points[tet[tet != inner]].mean(axis=0) - good.points[inner]
    for share in np.arange(0.95, 0, -0.05):
        points = good.points.copy()
        points[inner] += share * to
        flat = replace(good, points=points)
        if (flat.volumes() > 0).all():
            break
    before, after = Quality.of(flat), Quality.of(smooth_hull(flat, {}))
    print(before.summary(), after.summary())
    assert before.dihedrals.min() < 8 and after.dihedrals.min() > 11
    fixed = np.unique(good.triangles)
    assert np.array_equal(smooth_hull(flat, {}).points[fixed], points[fixed])


def test_ventricles_that_touch_the_surface_are_kept_under_it():
    points, affine = grid(46)
    away = np.linalg.norm(points, axis=-1)
    beside = np.linalg.norm(points - np.array([30.0, 0, 0]), axis=-1)
    numbers = np.where(away < 40, np.where(beside < 12, 2, 1), 0)
    made = hull(LabelMap(Volume(numbers, affine), {1: "grey", 2: "ventricles"}), EVEN).elements
    wall = made.points[np.unique(made.triangles[made.boundary == made.boundaries.index("ventricle_wall")])]
    assert np.linalg.norm(wall, axis=1).max() < 38.7e-3 and Quality.of(made).dihedrals.min() > 3


@pytest.mark.parametrize("fault", ["island", "hole", "cavity", "speck"])
def test_labels_with_faults_give_the_same_head(labels, made, fault):
    numbers = labels.volume.data.copy()
    middle = len(numbers) // 2
    if fault == "island":
        numbers[1:13, 1:13, 1:13] = 1
    elif fault == "hole":
        numbers[middle + 20, middle, middle] = 0
    elif fault == "cavity":  # a resection: outside is open to the surface by a channel of a voxel
        numbers[middle + 15 :, middle, middle] = 0
    else:
        numbers[middle + 25, middle, middle] = 3
    other = hull(LabelMap(Volume(numbers, labels.volume.affine), labels.names), EVEN).elements
    assert sum(volumes_ml(other).values()) == pytest.approx(sum(volumes_ml(made).values()), rel=1e-3)
    assert volumes_ml(other)["ventricles"] == pytest.approx(volumes_ml(made)["ventricles"], rel=2e-3)
    assert np.linalg.norm(other.points, axis=1).max() < 41 * MM


@pytest.mark.parametrize("spacing", [0.5, 3.0])
def test_voxels_of_other_sizes(spacing):
    radii = (30.0, 20.0, 9.0)
    labels = nested(radii, spacing=spacing)
    made = hull(labels, EVEN).elements
    wanted, found = labels.volumes_ml(), volumes_ml(made)
    print(spacing, found, wanted)
    assert sum(found.values()) == pytest.approx(sum(wanted.values()), rel=0.01)
    assert found["ventricles"] == pytest.approx(wanted["ventricles"], rel=0.06)


def test_an_oblique_grid_shows_the_same_head(labels, made):
    other = hull(turned(labels, rotation(25.0, np.array([1.0, 2.0, 0.5]))), EVEN).elements
    assert volumes_ml(other) == pytest.approx(volumes_ml(made), rel=0.01)


def test_without_ventricles_there_is_one_region(labels):
    made = hull(LabelMap(labels.volume, {1: "label_1", 2: "label_2", 3: "label_3"}), EVEN).elements
    assert made.regions == ("brain",) and made.boundaries == ("skull",)


def test_the_map_of_a_mesh_on_voxels_is_the_labels(labels, made):
    volume = labels.volume
    found, voxels, owner = voxelise(made, volume.affine, volume.data.shape)
    assert np.array_equal(found.data.ravel()[voxels], made.region[owner] + 1)
    for number, truth in ((2, volume.data == 3), (1, (volume.data > 0) & (volume.data < 3))):
        mine = found.data == number
        dice = 2 * (mine & truth).sum() / (mine.sum() + truth.sum())
        print(number, dice)
        assert dice > 0.97
    assert found.data.sum() * volume.voxel_volume == pytest.approx(
        sum(k * ml * 1e-6 for k, ml in zip((1, 2), volumes_ml(made).values(), strict=True)), rel=2e-3
    )


def test_a_mesh_comes_from_the_cache_unless_size_or_labels_change(labels, tmp_path, monkeypatch):
    monkeypatch.setenv("NGBRAIN_CACHE", str(tmp_path))
    first = mesh_elements(labels, "hull", EVEN)
    assert len(list(tmp_path.iterdir())) == 1
    again = mesh_elements(labels, "hull", EVEN)
    assert np.array_equal(first.points, again.points) and len(list(tmp_path.iterdir())) == 1
    assert len(mesh_elements(labels, "hull", RadialSizeField(8e-3, 8e-3)).tets) != len(first.tets)
    assert len(list(tmp_path.iterdir())) == 2
    other = LabelMap(labels.volume, {1: "grey", 2: "white", 3: "lesion"})
    assert mesh_elements(other, "hull", EVEN).regions == ("brain", "lesion")


def test_what_cannot_be_meshed_is_refused(labels):
    with pytest.raises(InputError, match="labels is less than a millilitre; wanted: a head"):
        outlines(nested((3.0, 2.0, 1.0)))
    with pytest.raises(InputError, match="mesh size is 0 mm near and 5 mm far"):
        RadialSizeField(0.0, 5e-3)
    with pytest.raises(InputError, match="mesh size is 6 mm near and 5 mm far"):
        RadialSizeField(6e-3, 5e-3)
    with pytest.raises(InputError, match="route is 'hul'; wanted: did you mean 'hull'"):
        mesh_elements(labels, "hul")
    with pytest.raises(InputError, match="mesh size is inf mm near and inf mm far"):
        RadialSizeField(np.inf, np.inf)
    for radius in (-5e-3, np.nan):
        with pytest.raises(InputError, match=r"radius is (-5|nan) mm; wanted: a length from 0 on"):
            RadialSizeField(2e-3, 5e-3, (0.0, 0.0, 0.0), radius)
    with pytest.raises(InputError, match=r"size is so small that \S+ tetrahedra would result; wanted: at most 5e\+06"):
        mesh_elements(labels, "hull", RadialSizeField(5e-5, 5e-5))
