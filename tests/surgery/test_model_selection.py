"""Operations with quantities of interest: axes, models, and the search against the richest model."""

from dataclasses import replace

import numpy as np
import pytest

import ngbrain
from ngbrain.errors import InputError
from ngbrain.ladder.axes import richest
from ngbrain.ladder.estimates import relative_difference
from ngbrain.ladder.model_search import search_along
from ngbrain.ladder.solutions import SolutionCache
from ngbrain.materials.families import is_neo_hooke
from ngbrain.scene import Quantity, Scene
from ngbrain.surgery.model_selection import Operation, _sizes, axes_of, solve

PEAK = Quantity(name="peak_pressure_mmHg", tolerance=0.3)


def asked(*quantities: Quantity, **sizes: float) -> Scene:
    """A short and shallow opening of the coarse idealised head."""
    scene = Scene.shipped("idealised_fast")
    return replace(
        scene,
        quantities=quantities,
        protocols=scene.protocols[:1],
        mesh=replace(scene.mesh, **sizes),
        tools=(replace(scene.tool, travel=1e-3),),
        time=replace(scene.time, ramp=10.0, end=12.0),
    )


def test_axes_are_those_that_an_operation_has() -> None:
    scene = asked(PEAK)
    assert set(axes_of(scene)) == {"tissue", "stiffening", "time", "mesh"}
    rubbed = replace(scene, tools=(replace(scene.tool, friction=0.2),))
    assert axes_of(rubbed)["friction"].levels == ("none", "all")
    one = replace(scene, tissues=(replace(scene.tissues[2], region=".*"),))
    assert set(axes_of(one)) == {"mesh"}
    assert axes_of(scene, {"time": "relaxed"})["time"].levels == ("relaxed",)
    with pytest.raises(InputError, match="tisue"):
        axes_of(scene, {"tisue": "one"})
    with pytest.raises(InputError, match="relaxed, flowing"):
        axes_of(scene, {"time": "prony"})


def test_elements_get_smaller_down_to_the_scenes_own() -> None:
    fine = asked(PEAK, wall=3e-3, craniotomy=8e-3, largest=24e-3)
    assert axes_of(fine)["mesh"].levels == ("0", "1", "2")
    assert axes_of(fine, {"mesh": "0"})["mesh"].levels == ("0",)
    assert axes_of(asked(PEAK))["mesh"].levels == ("0", "1")  # √2 times 4 mm is as good as the largest, 6 mm
    assert axes_of(asked(PEAK, wall=8e-3, craniotomy=14e-3, largest=36e-3))["mesh"].levels == ("0",)
    coarse, own = (_sizes(fine, factor) for factor in (2.0, 1.0))
    assert coarse == {"wall": 6e-3, "craniotomy": 14e-3, "largest": 36e-3}
    assert own == {"wall": 3e-3, "craniotomy": 8e-3, "largest": 24e-3}


def test_models_leave_out_what_they_say() -> None:
    scene = asked(PEAK)
    operation = Operation(replace(scene, tools=(replace(scene.tool, friction=0.2),)))
    whole = operation.build_model(
        {"mesh": "0", "tissue": "each", "stiffening": "all", "time": "flowing", "friction": "all"}
    )
    poor = operation.build_model(
        {"mesh": "0", "tissue": "one", "stiffening": "none", "time": "relaxed", "friction": "none"}
    )
    assert whole.scene.tissues == scene.tissues and whole.scene.tool.friction == 0.2
    assert poor.scene.tool.friction == 0.0
    white = next(tissue for tissue in scene.tissues if tissue.region == "white")
    for before, after in zip(scene.tissues, poor.scene.tissues, strict=True):
        assert after.region == before.region
        assert after.law() == white.with_alpha(2.0).law() and is_neo_hooke(after.law())
        assert [b.eta for b in after.law().branches] == [b.eta for b in white.law().branches]
    assert poor.mesh is whole.mesh


def test_what_is_asked_has_to_mean_something() -> None:
    with pytest.raises(InputError, match="quantity is missing"):
        solve(replace(asked(PEAK), quantities=()))
    with pytest.raises(InputError, match=r"quantity#1.protocol"):
        asked(replace(PEAK, protocol="continous"))
    with pytest.raises(InputError, match=r"quantity#2.name"):
        asked(PEAK, replace(PEAK, tolerance=0.2))
    with pytest.raises(InputError, match="tolerance"):
        asked(replace(PEAK, tolerance=3.0))
    again = Scene.from_dict(asked(PEAK, Quantity(name="mps_p95", protocol="continuous")).to_dict())
    assert [quantity.label for quantity in again.quantities] == ["peak_pressure_mmHg", "mps_p95 of continuous"]


@pytest.mark.slow
def test_an_operation_climbs_where_its_questions_want_it() -> None:
    """Half a millimetre of opening: stiffening by Griffiths' law raises the pressure by more than 5 %."""
    scene = asked(replace(PEAK, tolerance=0.05))
    scene = replace(
        scene,
        tools=(replace(scene.tool, travel=5e-4),),
        time=replace(scene.time, end=10.1, max_step_contact=10.0, step_tolerance=0.1),
    )
    result = ngbrain.simulate(scene, richest={"tissue": "one", "time": "relaxed", "mesh": "0"})
    assert result["model"] == {"tissue": "one", "stiffening": "all", "time": "relaxed", "mesh": "0"}
    first, last = result["models"]
    assert first["next_axes"] == ["stiffening"] and last["answers"][0] > 1.05 * first["answers"][0] > 0
    assert not result["left_out"] and first["estimates"]["stiffening"]["method"] == "solved"


@pytest.mark.slow
def test_the_chosen_model_of_an_operation_is_as_accurate_as_asked() -> None:
    scene = asked(replace(PEAK, tolerance=0.1), Quantity(name="mps_p95", tolerance=0.1))
    scene = replace(scene, tools=(replace(scene.tool, travel=5e-3),), time=replace(scene.time, end=120.0))
    axes, cache = axes_of(scene), SolutionCache(Operation(scene))
    found = search_along(axes, cache, np.full(2, 0.1), lambda _: None)
    rich = cache(richest(axes)).answers
    assert np.abs(relative_difference(found.chosen.answers, rich)).max() < 0.1
    assert found.chosen.model["stiffening"] == "all" and found.chosen.model != richest(axes)
