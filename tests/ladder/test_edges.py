"""Forces where held faces meet and move apart: they have no limit, and the ladder says so."""

import numpy as np
import pytest

from ngbrain.ladder.bodies import Bench, solve
from ngbrain.ladder.climb import climb
from ngbrain.ladder.edges import torn
from ngbrain.mesh import block
from ngbrain.scene.loading import Ask, Given, Loading, Piece, Stuff

AWAY = Given(boundary="left", by=(-1e-3, 0, 0))
FOOT, FORCE = Given(boundary="bottom"), Ask(boundary="left", direction=(1, 0, 0), tolerance=0.5)


def scene(*given: Given, ask: Ask = FORCE) -> Loading:
    return Loading(piece=Piece(size=(0.04, 0.03, 0.03), cell=0.03), stuff=(Stuff(mu=(1e3,)),), given=given, ask=(ask,))


@pytest.mark.parametrize(
    ("of", "doubted"),
    [
        (scene(FOOT, AWAY), True),
        (scene(AWAY, FOOT), True),
        (scene(FOOT, Given(boundary="top", by=(0, 0, 1e-3)), ask=Ask(boundary="top")), False),
        (scene(FOOT, Given(boundary="left|right")), False),
        (scene(Given(boundary="bottom", along="z"), AWAY), False),
        (scene(Given(boundary="bottom", along="z"), Given(boundary="left", by=(0, 0, 1e-3))), True),
        (scene(Given(boundary="bottom", along="z"), Given(boundary="left", by=(-1e-3, 0, 0), along="x")), False),
        (scene(FOOT, AWAY, ask=Ask(quantity="displacement", point=(0, 0, 0.02))), False),
        (scene(FOOT, AWAY, Given(boundary="right"), ask=Ask(boundary="right")), False),
    ],
)
def test_what_is_torn(of: Loading, doubted: bool) -> None:
    assert bool(torn(of, block((0.04, 0.03, 0.03), 0.03))) == doubted


def test_the_force_grows_without_end_and_the_ladder_says_so() -> None:
    of = scene(FOOT, AWAY)
    bench, forces = Bench(of), []
    for mesh in ("0", "1", "2"):
        model = {"strain": "linear", "pressure": "unknown", "space": "plane", "order": "1", "mesh": mesh}
        forces.append(solve(bench, model).answers[0])
    steps = np.diff(forces)
    assert abs(steps[1]) > 0.8 * abs(steps[0]) > 0.05 * abs(forces[0])
    assert any("bottom and left meet at an edge" in flag for flag in climb(of, {"order": "1", "mesh": "0"}).warnings)
