"""Solutions that are kept, and those that estimates quantity for at the same time."""

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import ngbrain
from ngbrain.errors import SolverError
from ngbrain.ladder.levels import Model
from ngbrain.ladder.models.hierarchy import ModelHierarchy, Solution
from ngbrain.ladder.solutions import SolutionCache
from ngbrain.scene import DisplacementBC, Geometry, MeshSize, Quantity, Scene, Time, Tissue


class Odd:
    """A bench on which odd models have no answer."""

    asked: list[str] = []  # noqa: RUF012

    def __init__(self, scene: Any) -> None:
        self.init_arguments = (scene,)

    def solve(self, model: Model, near: Any = None) -> Solution:
        self.asked.append(model["number"])
        if int(model["number"]) % 2:
            raise SolverError(f"{model['number']} is odd")
        return Solution(np.array([float(model["number"])]), {}, 1, 100.0)

    def has_states(self, model: Model) -> bool:
        return model["number"] == "4"


def test_models_that_fail_are_asked_for_once() -> None:
    def of(*numbers: int) -> Callable[[Any], Any]:
        def estimate(solved: Any) -> Any:
            try:
                return [float(solved({"number": str(number)}).answers[0]) for number in numbers]
            except SolverError as error:
                return str(error)

        return estimate

    cache, begun = SolutionCache(Odd("a scene"), executor=1), time.process_time()
    found = cache.run_estimates({"even": of(2, 6), "odd": of(2, 1), "here": of(4, 8)})
    assert found == {"even": [2.0, 6.0], "odd": "1 is odd", "here": [4.0, 8.0]}
    assert Odd.asked == ["2", "6", "1", "4", "8"]  # what has states comes last: it is solved here
    with pytest.raises(SolverError, match="1 is odd"):
        cache({"number": "1"})
    assert len(Odd.asked) == 5
    assert 200 <= cache.clock() - begun < 300


@pytest.mark.slow
def test_estimates_side_by_side_are_the_same_bits(monkeypatch: pytest.MonkeyPatch) -> None:
    here, solve = list[Model](), ModelHierarchy.solve

    def counted(self: ModelHierarchy, model: Model, near: Any = None) -> Solution:
        here.append(model)
        return solve(self, model, near)

    monkeypatch.setattr(ModelHierarchy, "solve", counted)
    given = (DisplacementBC(boundary="bottom"), DisplacementBC(boundary="top", value=(0, 0, -1e-4)))
    piece, stuff = (
        Geometry(kind="block", size=(0.02, 0.02, 0.02)),
        (Tissue(poissons_ratio=0.49, mu=(1e3,), loss_tangent=0.3),),
    )
    asks = (Quantity(name="force", boundary="top", tolerance=0.05),)
    wave = Scene(
        mesh=MeshSize(largest=0.02),
        geometry=piece,
        tissues=stuff,
        displacement_bcs=given,
        quantities=asks,
        time=Time(frequency=50.0),
    )
    memory = replace(
        wave, tissues=(Tissue(poissons_ratio=0.49, mu=(1e3, 1e3), eta=(1e3,)),), time=Time(ramp=1.0, end=10.0)
    )
    for scene in (wave, memory):
        found, counts = [], []
        for executor in (None, 2):
            here.clear()
            result = ngbrain.simulate(scene, richest={"order": "1", "mesh": "0"}, executor=executor).to_dict()
            del result["time_s"]
            assert all(rung.pop("cost_s") > 0 for rung in result["models"])
            found.append(result)
            counts.append(len(here))
        assert found[0] == found[1]
        assert counts[1] < counts[0]
