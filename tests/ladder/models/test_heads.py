"""The head of a scan under loads."""

import ngsolve as ngs
import numpy as np
import pytest

pytest.importorskip("nilearn")

from ngbrain.image import mni152
from ngbrain.image.labelling import label_tissues
from ngbrain.image.segment.tissue_classes import GREY, VENTRICLE, WHITE
from ngbrain.ladder.axes import axes_of
from ngbrain.ladder.models.hierarchy import ModelHierarchy
from ngbrain.scene import DisplacementBC, Geometry, Quantity, Scene, Tissue

A = 1e-3 * np.array([[1, 2, -1], [0, -2, 3], [2, 1, 1]])
PLACES = ((0.02, -0.02, 0.03), (-0.03, 0.01, 0.01))


@pytest.mark.slow
def test_a_head_takes_the_map_of_its_skull() -> None:
    """Of one tissue, an affine map of the skull is the solution everywhere; regions are as large as their labels."""
    scene = Scene(
        geometry=Geometry(kind="mni152"),
        tissues=[Tissue(mu=1000.0, poissons_ratio=0.4)],
        displacement_bcs=[
            DisplacementBC(boundary="skull", value=tuple(f"{a}*x + {b}*y + {c}*z" for a, b, c in A.tolist()))
        ],
        quantities=[Quantity(name="displacement", point=place, direction=(1, 0, 0)) for place in PLACES],
    )
    assert "space" not in axes_of(scene) and "extent" not in axes_of(scene)
    bench = ModelHierarchy(scene)
    model = {"strain": "linear", "pressure": "none", "order": "1", "mesh": "0"}
    assert bench.solve(model).answers == pytest.approx([A[0] @ place for place in PLACES], rel=1e-5)
    mesh, labels = bench.mesh(model), label_tissues(mni152()).volume
    assert set(mesh.GetMaterials()) == {"grey", "white", "ventricles"} and set(mesh.GetBoundaries()) >= {"skull"}
    ml = {name: 1e6 * ngs.Integrate(ngs.CF(1) * ngs.dx(name), mesh) for name in set(mesh.GetMaterials())}
    counted = {kind: 1e6 * labels.voxel_volume * (labels.data == kind).sum() for kind in (GREY, WHITE, VENTRICLE)}
    assert ml["ventricles"] == pytest.approx(counted[VENTRICLE], rel=0.15)
    assert ml["white"] / (ml["white"] + ml["grey"]) == pytest.approx(
        counted[WHITE] / (labels.data > 0).sum() / 1e6 / labels.voxel_volume, abs=0.1
    )
