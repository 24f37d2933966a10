"""Measured maps of stiffness: where they lie, what they do to a body, and when they are worth having."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("nibabel", reason='nibabel is not installed; get it with: pip install "ngbrain[mri]"')

from ngbrain.errors import InputError  # noqa: E402
from ngbrain.image.read.nifti import write_nifti  # noqa: E402
from ngbrain.image.read.volume import Volume  # noqa: E402
from ngbrain.ladder.axes import axes_of, cheapest  # noqa: E402
from ngbrain.ladder.estimates import relative_difference  # noqa: E402
from ngbrain.ladder.model_search import estimate, search_models  # noqa: E402
from ngbrain.ladder.models.geometry import Meshes  # noqa: E402
from ngbrain.ladder.models.hierarchy import ModelHierarchy, solve  # noqa: E402
from ngbrain.ladder.models.property_maps import interpolate_map, read_modulus_map  # noqa: E402
from ngbrain.ladder.solutions import SolutionCache
from ngbrain.scene import DisplacementBC, Geometry, MeshSize, Quantity, Scene, Time, Tissue  # noqa: E402

SIDE, LENGTH, FAR = 0.02, 0.04, 1e-4
BAR = Geometry(kind="block", size=(SIDE, SIDE, LENGTH))
STEP = 2e-3
GRID = np.array([[STEP, 0, 0, -0.012], [0, STEP, 0, -0.012], [0, 0, STEP, -0.002], [0, 0, 0, 1]])
SHAPE = (13, 13, 23)


def volume(of, shape=SHAPE) -> Volume:
    """Values of a function of x, y, z (m) on voxels around the bar."""
    return Volume(
        of(*np.einsum("ij,jklm->iklm", GRID[:3, :3], np.indices(shape)) + GRID[:3, 3, None, None, None]), GRID
    )


@pytest.fixture
def stiffening(tmp_path) -> str:
    """A file of 1 kPa at the foot, growing evenly to 2 kPa at the top."""
    file = tmp_path / "map.nii.gz"
    write_nifti(file, volume(lambda x, y, z: 1000 * (1 + z / LENGTH) + 0 * x))
    return str(file)


def pulled(file: str, tolerance: float = 0.01) -> Scene:
    """Without a change of width: a force of area × strain, where strain follows 1/modulus."""
    given = (DisplacementBC(boundary="bottom", components="z"), DisplacementBC(boundary="left|right", components="x"))
    given += (
        DisplacementBC(boundary="front|back", components="y"),
        DisplacementBC(boundary="top", value=(0, 0, FAR), components="z"),
    )
    tissue = Tissue(mu=(1.0,), poissons_ratio=0.0, shear_modulus_map=file)
    return Scene(
        mesh=MeshSize(largest=0.02),
        geometry=BAR,
        tissues=(tissue,),
        displacement_bcs=given,
        quantities=(Quantity(name="force", boundary="top", tolerance=tolerance),),
    )


def levels(scene: Scene, **of: str) -> dict[str, str]:
    return {**cheapest(axes_of(scene)), "space": "solid", "order": "3", **of}


def test_a_bar_that_stiffens_has_its_force(stiffening) -> None:
    """F = A d / ∫ dz/2μ(z) with the map, and with its median 2 · 1.5 kPa · A d / L without."""
    scene = pulled(stiffening)
    area, bench = SIDE**2, ModelHierarchy(scene)
    mapped, plain = (solve(bench, levels(scene, tissue=level)).answers[0] for level in ("map", "each"))
    assert mapped == pytest.approx(area * FAR * 2000 / (LENGTH * np.log(2)), rel=2e-3)
    assert plain == pytest.approx(area * FAR * 3000 / LENGTH, rel=1e-3)
    flat = solve(bench, levels(scene, tissue="map", space="plane")).answers[0]
    assert flat == pytest.approx(mapped, rel=2e-3)


def test_a_map_is_taken_where_it_is_worth_it_and_foretold(stiffening) -> None:
    scene = pulled(stiffening)
    assert axes_of(scene)["tissue"].levels == ("each", "map")
    cache, model = SolutionCache(ModelHierarchy(scene)), levels(scene, order="2")
    found = estimate(cache, model, axes_of(scene)["tissue"])
    true = relative_difference(cache(model).answers, cache({**model, "tissue": "map"}).answers)
    assert found.change == pytest.approx(true, rel=1e-3) and true[0] == pytest.approx(2 / (3 * np.log(2)) - 1, rel=0.1)
    bounds = {"order": "2", "mesh": "0", "space": "plane"}
    for tolerance, level in ((0.01, "map"), (0.2, "each")):
        assert search_models(pulled(stiffening, tolerance), bounds).chosen.model["tissue"] == level


def test_several_tissues_have_all_three_levels(stiffening) -> None:
    piece = replace(BAR, lesion_radius=0.005, lesion_centre=(0, 0, 0.03))
    scene = replace(pulled(stiffening), geometry=piece)
    scene = replace(scene, tissues=tuple(replace(scene.tissues[0], region=name) for name in ("tissue", "lesion")))
    assert axes_of(scene)["tissue"].levels == ("one", "each", "map")
    bench = ModelHierarchy(scene)
    assert bench.factor("lesion", {"tissue": "each"}) == pytest.approx(1750, rel=0.02)
    assert bench.factor("lesion", {"tissue": "one"}) == bench.factor("tissue", {"tissue": "each"}) < 1600
    assert axes_of(scene, {"tissue": "each"})["tissue"].levels == ("one", "each")


def test_a_wave_feels_it(stiffening) -> None:
    """Slow shear: half way up it has moved ln 1.5 / ln 2 as far as at the top."""
    given = (DisplacementBC(boundary="bottom"), DisplacementBC(boundary="left|right|front|back", components="yz"))
    given += (DisplacementBC(boundary="top", value=(FAR, 0, 0)),)
    quantity = Quantity(name="displacement", point=(0, 0, LENGTH / 2), direction=(1, 0, 0))
    scene = replace(pulled(stiffening), displacement_bcs=given, quantities=(quantity,), time=Time(frequency=1.0))
    found = solve(ModelHierarchy(scene), levels(scene, tissue="map", inertia="none")).answers[0]
    assert found == pytest.approx(FAR * np.log(1.5) / np.log(2), rel=2e-3)


@pytest.mark.parametrize("level", ["instantaneous", "relaxed", "prony", "flowing"])
def test_moduli_and_viscosities_are_in_proportion_to_it(level, tmp_path) -> None:
    """A map of twice the constants has twice their force at all times."""
    tissue = Tissue(mu=(400.0, 600.0), eta=(1200.0,), poissons_ratio=0.3)
    write_nifti(tmp_path / "twice.nii", volume(lambda x, y, z: 2000 + 0 * x))
    course = Time(ramp=1.0, end=4.0)
    scene = replace(pulled("none.nii"), time=course, tissues=(tissue,))
    mapped = replace(scene, tissues=(replace(tissue, shear_modulus_map=str(tmp_path / "twice.nii")),))
    plain, twice = (
        solve(ModelHierarchy(each), levels(each, order="1", space="plane", time=level, strain="finite", **of)).answers[
            0
        ]
        for each, of in ((scene, {}), (mapped, {"tissue": "map"}))
    )
    assert twice == pytest.approx(2 * plain, rel=1e-9)


def test_voxels_without_a_value_have_that_of_their_neighbours(tmp_path) -> None:
    cut = volume(lambda x, y, z: np.where(z > 0.035, np.nan, np.where(z < 0.003, 0.0, 1e3 + 1e5 * z)))
    write_nifti(tmp_path / "cut.nii", cut)
    values = (
        interpolate_map(read_modulus_map(tmp_path / "cut.nii"), Meshes(BAR, 0.02).mesh(1, plane=False)).vec.FV().NumPy()
    )
    known = cut.data[np.isfinite(cut.data) & (cut.data > 0)]
    assert values.min() >= known.min() * (1 - 1e-12)  # means of values that are equal there
    assert values.max() == pytest.approx(known.max(), rel=1e-6)


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (volume(lambda x, y, z: 0 * x), "without a value"),
        (Volume(np.ones((*SHAPE, 2)), GRID), "4 axes"),
        (volume(lambda x, y, z: 1000 + 0 * x, (13, 13, 15)), "ends 7 voxels inside"),
    ],
)
def test_maps_that_will_not_do(made, said, tmp_path) -> None:
    write_nifti(tmp_path / "map.nii", made)
    scene = pulled(str(tmp_path / "map.nii"))
    with pytest.raises(InputError, match=said):
        solve(ModelHierarchy(scene), levels(scene, tissue="map"))
    with pytest.raises(InputError, match=r"\.nii"):
        Tissue.read({"mu_Pa": [1.0], "shear_modulus_map": "map.png"})
