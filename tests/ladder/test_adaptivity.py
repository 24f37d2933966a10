"""Elements that get smaller where what is asked needs it: slopes of questions, and what a few of them are worth."""

from dataclasses import replace

import numpy as np
import pytest

from ngbrain.ladder.adaptivity import mark_elements
from ngbrain.ladder.axes import axes_of, cheapest
from ngbrain.ladder.estimates import Estimate, relative_difference
from ngbrain.ladder.model_search import search_models
from ngbrain.ladder.models.bodies import SMALL, linear_state
from ngbrain.ladder.models.hierarchy import ModelHierarchy, solve
from ngbrain.ladder.next_step import target_level
from ngbrain.ladder.quantities import BodyState, evaluate, gradient
from ngbrain.ladder.search_result import Rung
from ngbrain.ladder.solutions import SolutionCache
from ngbrain.scene import DisplacementBC, Geometry, MeshSize, Quantity, Scene, Tissue

PLATE = Geometry(kind="block", size=(0.06, 0.06, 0.04), plate=(0.02, 0.02))
PRESSED = (DisplacementBC(boundary="bottom"), DisplacementBC(boundary="plate", value=(0, 0, -1e-3)))
FORCE = Quantity(name="force", boundary="plate")
AWAY = Quantity(name="displacement", point=(0.02, 0.0, 0.04), direction=(0.6, 0, 0.8))
STRAIN = Quantity(name="strain", point=(0, 0, 0.04), radius=0.03, percentile=60)


def scene(*asks: Quantity) -> Scene:
    """A plate on a block."""
    return Scene(
        mesh=MeshSize(largest=0.02),
        geometry=PLATE,
        tissues=(Tissue(mu=(1e3,), poissons_ratio=0.45),),
        displacement_bcs=PRESSED,
        quantities=asks or (FORCE,),
    )


def linear(asked: Scene, **levels: str) -> dict[str, str]:
    """The cheapest model but for some levels."""
    return {**cheapest(axes_of(asked)), **levels}


@pytest.mark.parametrize(("quantity", "within"), [(FORCE, 1e-4), (AWAY, 1e-6), (STRAIN, 0.4)])
@pytest.mark.parametrize("space", ["plane", "solid"])
@pytest.mark.parametrize("pressure", ["none", "unknown"])
def test_slopes_are_those_of_the_answers(quantity: Quantity, within: float, space: str, pressure: str, rng) -> None:
    """Of a percentile roughly: the mean of a band of elements stands for it."""
    asked = scene(quantity)
    bench, model = ModelHierarchy(asked), linear(asked, space=space, pressure=pressure, order="2", extent="whole")
    body = bench.static(model, 1.0)
    x = linear_state(body)
    smooth = linear_state(bench.static({**model, "tissue": "each"}, 1.0))  # an answer of its own size
    change = 1e-3 * np.where(body.weights > 0, smooth * (1 + 0.3 * rng.normal(size=len(x))), 0)
    states = [BodyState(body, x + sign * change, SMALL, True, bench.thickness_of(model)) for sign in (-1, 1)]
    before, after = (evaluate(quantity, state) for state in states)
    foretold = 2 * gradient(quantity, BodyState(body, x, SMALL, True, bench.thickness_of(model))) @ change
    assert abs(after - before) > 1e-5 * abs(before)
    assert foretold == pytest.approx(after - before, rel=within)


def test_a_percentile_beyond_all_elements_is_the_nearest_ones() -> None:
    asked = scene(replace(STRAIN, percentile=100, radius=0.004))
    bench, model = ModelHierarchy(asked), linear(asked, space="solid", extent="whole")
    body = bench.static(model, 1.0)
    state = BodyState(body, linear_state(body), SMALL, True)
    assert np.isfinite(gradient(asked.quantities[0], state)).all() and gradient(asked.quantities[0], state).any()


def test_the_fewest_that_leave_out_most_are_chosen() -> None:
    assert mark_elements(np.array([1.0, 5.0, 2.0, 2.0]), 0.5).tolist() == [False, True, False, False]
    assert mark_elements(np.array([1.0, 5.0, 2.0, 2.0]), 1.0).all()
    assert not mark_elements(np.zeros(3), 0.5).any()


@pytest.mark.parametrize(("quantity", "left"), [(FORCE, 0.25), (STRAIN, 0.25)])
def test_a_part_of_the_elements_does_most_of_what_all_do(quantity: Quantity, left: float) -> None:
    asked = scene(quantity)
    bench = ModelHierarchy(asked)
    model = linear(asked, space="solid", order="2", extent="whole")
    coarse, part, whole = (solve(bench, {**model, "mesh": level}) for level in ("0", "0+", "1"))
    assert part.ndof < 0.7 * whole.ndof
    all_of_it = abs(relative_difference(coarse.answers, whole.answers)[0])
    assert all_of_it > 0.01
    assert abs(relative_difference(part.answers, whole.answers)[0]) < left * all_of_it


def test_a_step_is_judged_whole_and_climbed_in_part_where_that_will_do() -> None:
    asked = scene()
    axes = axes_of(asked)
    assert [axes["mesh"].estimated_level(level) for level in ("0", "0+", "1", "1+")] == ["1", "1", "2", "2"]
    for change, order, taken, to in (
        (0.02, "1", ("mesh",), "0+"),
        (0.03, "1", ("mesh",), "1"),
        (0.04, "1", ("mesh", "order"), "0+"),
        (0.06, "1", ("mesh", "order"), "1"),
        (0.02, "2", ("mesh",), "0+"),
    ):
        model = linear(asked, order=order)
        changes = {name: Estimate(np.full(1, change), "", to="1") for name in taken}
        rung = Rung(model, np.ones(1), 1, changes, np.ones(1), taken)
        assert target_level(axes["mesh"], rung, np.full(1, 0.01)) == to
    order = Rung(linear(asked), np.ones(1), 1, {"order": Estimate(np.ones(1), "", to="2")}, np.ones(1), ("order",))
    assert target_level(axes["order"], order, np.ones(1)) == "2"


def test_a_bound_may_be_a_part_and_heads_have_none() -> None:
    asked = scene()
    axes = axes_of(asked, {"mesh": "0+"})
    assert axes["mesh"].levels == ("0", "0+") and axes["mesh"].estimated_level("0") == "0+"
    head = replace(
        asked,
        geometry=Geometry(kind="idealised"),
        displacement_bcs=(DisplacementBC(boundary="skull"),),
        quantities=(AWAY,),
    )
    assert axes_of(head)["mesh"].levels == ("0", "1", "2")
    assert len(axes_of(head)["mesh"].left_out) == len(axes_of(head)["mesh"].by) == 2


def test_a_climb_goes_over_a_part_and_is_as_accurate_as_asked() -> None:
    asked = scene(replace(FORCE, tolerance=0.03))
    bounds = {"order": "2", "mesh": "1", "strain": "linear", "extent": "near"}
    cache = SolutionCache(ModelHierarchy(asked))
    found = search_models(asked, bounds, cache=cache)
    assert found.chosen.model["mesh"] == "0+"
    rich = cache({**found.chosen.model, "order": "2", "mesh": "1"}).answers
    assert np.abs(relative_difference(found.chosen.answers, rich)).max() < 0.03


def test_a_model_starts_where_the_one_most_like_it_came_to_rest(monkeypatch) -> None:
    asked = scene()
    cache = SolutionCache(ModelHierarchy(asked))
    model = linear(asked, strain="finite", space="solid", extent="whole")
    first = cache(model)
    cache({**model, "space": "plane"})
    assert cache._similar_states({**model, "order": "2"}) is first.states
    assert cache._similar_states({**model, "order": "2", "extent": "near"}) is None
    assert cache._similar_states({**model, "strain": "linear"}) is None
    near = cache({**model, "order": "2"})
    assert cache._similar_states({**model, "order": "2", "mesh": "1"}) is near.states
    alone = solve(cache.solver, {**model, "order": "2"})
    assert near.answers == pytest.approx(alone.answers, rel=1e-6)
