"""A measured map of moduli in a retraction: only ratios count."""

from dataclasses import replace

import ngsolve as ngs
import numpy as np
import pytest

pytest.importorskip("nibabel", reason='nibabel is not installed; get it with: pip install "ngbrain[mri]"')

from ngbrain.errors import InputError  # noqa: E402
from ngbrain.forward.common.interpolation import quadrature_field, quadrature_points  # noqa: E402
from ngbrain.image.read.nifti import write_nifti  # noqa: E402
from ngbrain.image.read.volume import Volume  # noqa: E402
from ngbrain.materials.families import law_after, shear_modulus  # noqa: E402
from ngbrain.mesh import block  # noqa: E402
from ngbrain.scene import Geometry, Scene, Tissue  # noqa: E402
from ngbrain.surgery import relative_stiffness  # noqa: E402
from ngbrain.surgery.head_models import _stiffness  # noqa: E402
from ngbrain.surgery.model import RetractionModel  # noqa: E402

SIDE, BORDER = 0.02, 0.4
MODULI = {"grey": 500.0, "white": 900.0}
PLACE = np.array([[1e-3, 0, 0, -15e-3], [0, 1e-3, 0, -15e-3], [0, 0, 1e-3, -15e-3], [0, 0, 0, 1]])
SHAPE = (51, 51, 51)


class Bar:
    """A head that is a block of two tissues in one region, with a measured map."""

    left_out = ""

    def __init__(self, stiffness: Volume | None):
        self.stiffness = stiffness

    def mixtures(self, mesh, order):
        space, points = quadrature_points(mesh, order - 1)
        white = points[:, 0] < BORDER * SIDE
        return {"bar": {"grey": quadrature_field(space, ~white), "white": quadrature_field(space, white)}}


def stiffening(factor: float = 1.0, jump: float = 3.0) -> Volume:
    """A map twice as stiff at z = SIDE as at 0, and 3 times as stiff in white matter."""
    x, _, z = np.einsum("ij,jklm->iklm", PLACE[:3, :3], np.indices(SHAPE)) + PLACE[:3, 3, None, None, None]
    return Volume(factor * 2500 * (1 + z / SIDE) * np.where(x < BORDER * SIDE, jump, 1), PLACE.copy())


def model_of(stiffness: Volume | None) -> RetractionModel:
    tissues = tuple(Tissue(region=name, mu=(mu,)) for name, mu in MODULI.items())
    mesh = block((SIDE,) * 3, SIDE / 5)
    mesh.ngmesh.SetMaterial(1, "bar")
    mesh = ngs.Mesh(mesh.ngmesh)
    return RetractionModel(replace(Scene.shipped("idealised_fast"), tissues=tissues), Bar(stiffness), mesh, None, {})


def moduli(model: RetractionModel) -> tuple[np.ndarray, np.ndarray]:
    """Shear moduli at the quadrature points, and their positions."""
    space, points = quadrature_points(model.mesh, model.scene.mesh.order - 1)
    found = ngs.GridFunction(space)
    found.Interpolate(shear_modulus(model.materials()["bar"].law.equilibrium))
    return found.vec.FV().NumPy().copy(), points


def test_each_tissue_keeps_its_mean_and_varies_as_the_map_does():
    model = model_of(stiffening())
    found, x = moduli(model)
    without, _ = moduli(model_of(None))
    white = x[:, 0] < BORDER * SIDE
    near = np.abs(x[:, 0] - BORDER * SIDE) < 1.5e-3  # there the map is between both tissues'
    for tissue, here in (("white", white), ("grey", ~white)):
        assert set(without[here]) == {MODULI[tissue]}
        slope = found[here & ~near] / (1 + x[here & ~near, 2] / SIDE)
        assert np.ptp(slope) < 1e-9 * slope.mean()
        assert slope.mean() == pytest.approx(MODULI[tissue] / 1.5, rel=0.06)
    told = model_of(stiffening(jump=1.0)).stiffness_map()
    assert told["white"]["ratio_p95"] / told["white"]["ratio_p5"] == pytest.approx(1.95 / 1.05, rel=0.05)
    assert not model_of(None).stiffness_map()


def test_a_map_of_moduli_is_that_of_a_tissue_itself(tmp_path):
    """White matter has the moduli of its map, grey matter those of the scene; plausibility is judged by the mean."""
    write_nifti(tmp_path / "mu.nii.gz", stiffening(jump=1.0))
    made = model_of(None)
    grey, white = made.scene.tissues
    mapped = replace(white, shear_modulus_map=str(tmp_path / "mu.nii.gz"))
    model = replace(made, scene=replace(made.scene, tissues=(grey, mapped)))
    found, x = moduli(model)
    here = x[:, 0] < BORDER * SIDE
    assert found[here] == pytest.approx(2500 * (1 + x[here, 2] / SIDE), rel=1e-6)
    assert set(found[~here]) == {MODULI["grey"]}
    assert (
        model.parts()["white"].modulus == pytest.approx(2500 * 1.5, rel=1e-3) and model.tissue("white").mu == white.mu
    )
    assert model.scaled_materials({"white": 2.0}).keys() == {"bar"} and model.stiffness_map().keys() == {"white"}
    assert model.tissues[1].initial_modulus == model.parts()["white"].modulus and model.scene.tissues[1].scale is None
    head = Geometry(kind="mni152", stiffness_map=str(tmp_path / "mu.nii.gz"))
    scanned = replace(Scene.shipped("demo"), geometry=head)
    with pytest.raises(
        InputError, match=r"tissue#1\.shear_modulus_map is .*; wanted: this key or geometry.stiffness_map"
    ):
        replace(scanned, tissues=(replace(scanned.tissues[0], shear_modulus_map="mu.nii.gz"), *scanned.tissues[1:]))


def test_the_mean_over_a_tissue_is_one():
    model = model_of(stiffening())
    order = model.scene.mesh.order
    mixtures = model.head.mixtures(model.mesh, order)
    for name, ratio in relative_stiffness.stiffness_ratio_fields(
        model.head.stiffness, model.mesh, mixtures, order - 1
    ).items():
        rule = ngs.dx(intrules=ratio.space.GetIntegrationRules())
        share = mixtures["bar"][name]
        assert ngs.Integrate(ratio * share * rule, model.mesh) == pytest.approx(
            ngs.Integrate(share * rule, model.mesh), rel=1e-12
        )


def test_the_unit_of_the_map_does_not_matter():
    np.testing.assert_allclose(moduli(model_of(stiffening(1e-3)))[0], moduli(model_of(stiffening()))[0], rtol=1e-9)


def test_relaxing_tissue_keeps_its_times_and_elastic_tissue_follows_too():
    model = model_of(stiffening())
    tissues = tuple(Tissue(region=name, mu=(mu, mu), alpha=(2.0, 2.0), eta=(3 * mu,)) for name, mu in MODULI.items())
    model.scene = replace(model.scene, tissues=tissues)
    law = model.materials()["bar"].law
    space, _ = quadrature_points(model.mesh, model.scene.mesh.order - 1)
    tau, modulus, elastic = (ngs.GridFunction(space) for _ in range(3))
    tau.Interpolate(law.branches[0].eta / shear_modulus(law.branches[0].law))
    modulus.Interpolate(shear_modulus(law.equilibrium))
    elastic.Interpolate(shear_modulus(model.elastic_materials(1.0)["bar"].law.equilibrium))
    share = shear_modulus(law_after(tissues[0].law(), 1.0)) / MODULI["grey"]
    np.testing.assert_allclose(tau.vec.FV().NumPy(), 3.0, rtol=1e-12)
    np.testing.assert_allclose(elastic.vec.FV().NumPy() / modulus.vec.FV().NumPy(), share, rtol=1e-9)


def test_a_map_that_is_not_of_this_head_is_refused_by_name():
    away = stiffening()
    away.affine[:3, 3] += 0.1
    with pytest.raises(InputError, match="shear_modulus_map: map is without a value at 100% of the body"):
        model_of(away).materials()


def test_what_was_not_measured_is_said():
    volume = stiffening()
    volume.data[:, :, 30:] = np.nan  # above 14.5 mm
    told = model_of(volume).stiffness_map()
    assert told["grey"]["not_measured"] == pytest.approx(0.275, abs=0.06)
    (line,) = relative_stiffness.summary_lines(told)
    assert f"{told['grey']['not_measured']:.0%} not measured" in line and not relative_stiffness.summary_lines({})
    scene = Scene.shipped("demo_fast")
    mapped = replace(scene, geometry=replace(scene.geometry, stiffness_map="map.nii"))
    (said,) = [text for text in mapped.warnings if text not in scene.warnings]
    assert "relative" in said and "its absolute values" in said


def test_a_map_in_the_template_goes_where_the_template_lies_in_the_head(tmp_path, monkeypatch):
    write_nifti(tmp_path / "map.nii.gz", stiffening())
    place = np.diag([0.9, 1.1, 1.0, 1.0])
    place[:3, 3] = 0.01, 0.02, 0.03
    monkeypatch.setattr("ngbrain.surgery.head_models.template_affine", lambda scan: place)
    told = {"kind": "scan", "image": "t1.nii", "stiffness_map": str(tmp_path / "map.nii.gz")}
    moved, still = (_stiffness(Geometry(**told, stiffness_map_space=space), None) for space in ("mni152", "head"))
    point = np.array([[5e-3, 4e-3, 3e-3]])
    np.testing.assert_allclose(moved.interpolate(point @ place[:3, :3].T + place[:3, 3]), still.interpolate(point))
    assert not np.allclose(moved.affine, still.affine)
