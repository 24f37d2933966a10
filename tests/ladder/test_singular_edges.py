"""Forces where held faces meet and move apart: they have no limit, and the ladder says so."""

import numpy as np
import pytest

from ngbrain.ladder.model_search import search_models
from ngbrain.ladder.models.hierarchy import ModelHierarchy, solve
from ngbrain.ladder.singular_edges import find_singular_edges
from ngbrain.mesh import block
from ngbrain.scene import DisplacementBC, Geometry, MeshSize, Quantity, Scene, Tissue

AWAY = DisplacementBC(boundary="left", value=(-1e-3, 0, 0))
FOOT, FORCE = (
    DisplacementBC(boundary="bottom"),
    Quantity(name="force", boundary="left", direction=(1, 0, 0), tolerance=0.5),
)


def scene(*given: DisplacementBC, quantity: Quantity = FORCE) -> Scene:
    return Scene(
        mesh=MeshSize(largest=0.03),
        geometry=Geometry(kind="block", size=(0.04, 0.03, 0.03)),
        tissues=(Tissue(poissons_ratio=0.49, mu=(1e3,)),),
        displacement_bcs=given,
        quantities=(quantity,),
    )


@pytest.mark.parametrize(
    ("of", "doubted"),
    [
        (scene(FOOT, AWAY), True),
        (scene(AWAY, FOOT), True),
        (
            scene(
                FOOT,
                DisplacementBC(boundary="top", value=(0, 0, 1e-3)),
                quantity=Quantity(name="force", boundary="top"),
            ),
            False,
        ),
        (scene(FOOT, DisplacementBC(boundary="left|right")), False),
        (scene(DisplacementBC(boundary="bottom", components="z"), AWAY), False),
        (
            scene(
                DisplacementBC(boundary="bottom", components="z"), DisplacementBC(boundary="left", value=(0, 0, 1e-3))
            ),
            True,
        ),
        (
            scene(
                DisplacementBC(boundary="bottom", components="z"),
                DisplacementBC(boundary="left", value=(-1e-3, 0, 0), components="x"),
            ),
            False,
        ),
        (scene(FOOT, AWAY, quantity=Quantity(name="displacement", point=(0, 0, 0.02))), False),
        (scene(FOOT, AWAY, DisplacementBC(boundary="right"), quantity=Quantity(name="force", boundary="right")), False),
    ],
)
def test_what_is_torn(of: Scene, doubted: bool) -> None:
    assert bool(find_singular_edges(of, block((0.04, 0.03, 0.03), 0.03))) == doubted


def test_the_force_grows_without_end_and_the_ladder_says_so() -> None:
    of = scene(FOOT, AWAY)
    bench, forces = ModelHierarchy(of), []
    for mesh in ("0", "1", "2"):
        model = {"strain": "linear", "pressure": "unknown", "space": "plane", "order": "1", "mesh": mesh}
        forces.append(solve(bench, model).answers[0])
    steps = np.diff(forces)
    assert abs(steps[1]) > 0.8 * abs(steps[0]) > 0.05 * abs(forces[0])
    assert any(
        "bottom and left meet at an edge" in flag for flag in search_models(of, {"order": "1", "mesh": "0"}).warnings
    )
