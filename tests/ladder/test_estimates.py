"""Estimates against changes that are known: where a step is linear, and where it is not."""

from dataclasses import replace

import numpy as np
import pytest

from ngbrain.errors import SolverError
from ngbrain.forward.solid.problem import Problem
from ngbrain.ladder.axes import axes_of, cheapest
from ngbrain.ladder.estimates import (
    Estimate,
    estimate_by_solution,
    estimate_linear_coarse,
    relative_difference,
    section_estimator,
)
from ngbrain.ladder.model_search import estimate
from ngbrain.ladder.models.hierarchy import ModelHierarchy
from ngbrain.ladder.solutions import SolutionCache
from ngbrain.scene import DisplacementBC, Geometry, MeshSize, Quantity, Scene, Time, Tissue, Traction

CUBE = Geometry(kind="block", size=(0.02, 0.02, 0.02))
SQUEEZED = (DisplacementBC(boundary="bottom"), DisplacementBC(boundary="top", value=(0, 0, -1e-3)))
FORCE = (Quantity(name="force", boundary="top"),)


def both(scene: Scene, model: dict[str, str], axis: str) -> tuple[float, float]:
    """Estimated and true change of the first answer."""
    axes, cache = axes_of(scene), SolutionCache(ModelHierarchy(scene))
    model = {**cheapest(axes), **model}
    richer = {**model, axis: axes[axis].next_level(model[axis])}
    found = estimate(cache, model, axes[axis])
    true = relative_difference(cache(model).answers, cache(richer).answers)
    return float(found.change[0]), float(true[0])


@pytest.mark.parametrize("axis", ["order", "pressure", "mesh", "space"])
def test_a_step_of_the_linear_body_is_foretold_exactly(axis: str) -> None:
    scene = Scene(
        mesh=MeshSize(largest=0.02),
        geometry=CUBE,
        tissues=(Tissue(poissons_ratio=0.49, mu=(1e3,)),),
        displacement_bcs=SQUEEZED,
        quantities=FORCE,
    )
    estimated, true = both(scene, {"order": "2"} if axis == "space" else {}, axis)
    assert abs(true) > 0.05
    assert estimated == pytest.approx(true, rel=1e-5)


@pytest.mark.parametrize("axis", ["order", "mesh"])
def test_elements_of_small_strains_are_judged_by_solutions_that_are_kept(axis: str) -> None:
    """They cost what a step of Newton's would; where strains are finite that is less than a solution."""
    scene = Scene(
        mesh=MeshSize(largest=0.02),
        geometry=CUBE,
        tissues=(Tissue(poissons_ratio=0.49, mu=(1e3,)),),
        displacement_bcs=SQUEEZED,
        quantities=FORCE,
    )
    axes, cache = axes_of(scene), SolutionCache(ModelHierarchy(scene))
    for strain, kept in (("linear", True), ("finite", False)):
        model = {**cheapest(axes), "strain": strain, "pressure": "unknown"}
        found = estimate(cache, model, axes[axis])
        richer = {**model, axis: found.to}
        assert (tuple(sorted(richer.items())) in cache.solutions) == kept
        assert ("weighted by adjoints" in found.method) != kept


def test_other_tissues_are_foretold_where_they_differ() -> None:
    piece = Geometry(kind="block", size=(0.02, 0.02, 0.02), lesion_radius=0.006, lesion_centre=(0, 0, 0.01))
    scene = Scene(
        mesh=MeshSize(largest=0.02),
        geometry=piece,
        tissues=(
            Tissue(poissons_ratio=0.49, region="tissue", mu=(1e3,)),
            Tissue(poissons_ratio=0.49, region="lesion", mu=(5e3,)),
        ),
        displacement_bcs=SQUEEZED,
        quantities=FORCE,
    )
    estimated, true = both(scene, {}, "tissue")
    assert abs(true) > 0.05
    assert estimated == pytest.approx(true, rel=1e-4)


@pytest.mark.parametrize("alpha", [-19.0, 2.0, 12.0])
def test_finite_strains_are_foretold_by_their_residual(alpha: float) -> None:
    given = (SQUEEZED[0], replace(SQUEEZED[1], value=(0, 0, -2e-3)))
    scene = Scene(
        mesh=MeshSize(largest=0.02),
        geometry=CUBE,
        tissues=(Tissue(mu=(1e3,), alpha=(alpha,), poissons_ratio=0.4),),
        displacement_bcs=given,
        quantities=FORCE,
    )
    estimated, true = both(scene, {"space": "solid", "order": "2"}, "strain")
    assert abs(true) > 0.03
    assert estimated == pytest.approx(true, rel=0.15)


@pytest.mark.parametrize(("mm", "factors"), [(0.4, 0), (4.0, 1)])
def test_small_strains_lend_their_factor_where_finite_ones_are_near(
    mm: float, factors: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = (SQUEEZED[0], replace(SQUEEZED[1], value=(0, 0, -mm / 1000)))
    scene = Scene(
        mesh=MeshSize(largest=0.02),
        geometry=CUBE,
        tissues=(Tissue(poissons_ratio=0.49, mu=(1e3,), alpha=(-19.0,)),),
        displacement_bcs=given,
        quantities=FORCE,
    )
    axes, cache, made = axes_of(scene), SolutionCache(ModelHierarchy(scene)), list[float]()
    model = {**cheapest(axes), "space": "solid", "order": "2", "pressure": "unknown"}
    cache(model)
    factorise = Problem.factorise
    monkeypatch.setattr(Problem, "factorise", lambda self, x, r: (made.append(0.0), factorise(self, x, r))[1])
    found = estimate(cache, model, axes["strain"]).change[0]
    assert len(made) == factors
    true = relative_difference(cache(model).answers, cache({**model, "strain": "finite"}).answers)[0]
    assert abs(true) > 0.03 and 0.3 < found / true < 1.5


def test_finite_strains_are_foretold_with_pressures() -> None:
    given = (SQUEEZED[0], replace(SQUEEZED[1], value=(0, 0, -2e-3)))
    scene = Scene(
        mesh=MeshSize(largest=0.02),
        geometry=CUBE,
        tissues=(Tissue(poissons_ratio=0.49, mu=(1e3,), alpha=(12.0,)),),
        displacement_bcs=given,
        quantities=FORCE,
    )
    estimated, true = both(scene, {"space": "solid", "pressure": "unknown"}, "strain")
    assert abs(true) > 0.03
    assert estimated == pytest.approx(true, rel=0.1)


def test_half_as_large_elements_are_foretold_where_strains_are_finite() -> None:
    given = (SQUEEZED[0], replace(SQUEEZED[1], value=(0, 0, 4e-3)))
    scene = Scene(
        mesh=MeshSize(largest=0.02),
        geometry=CUBE,
        tissues=(Tissue(mu=(1e3,), alpha=(-19.0,), poissons_ratio=0.4),),
        displacement_bcs=given,
        quantities=FORCE,
    )
    estimated, true = both(scene, {"strain": "finite"}, "mesh")
    assert abs(true) > 0.05
    assert estimated == pytest.approx(true, rel=0.3)


def test_relaxation_is_foretold_by_the_history_of_the_load() -> None:
    tissue, course = Tissue(mu=(400.0, 600.0), eta=(1200.0,), poissons_ratio=0.3), Time(ramp=1.0, end=4.0)
    scene = Scene(
        mesh=MeshSize(largest=0.02),
        geometry=CUBE,
        tissues=(tissue,),
        displacement_bcs=SQUEEZED,
        time=course,
        quantities=FORCE,
    )
    estimated, true = both(scene, {}, "time")
    assert estimated == pytest.approx(true, rel=1e-6)
    assert true > 0.1  # a press is a negative force


def test_a_change_that_is_large_is_doubted() -> None:
    given = (SQUEEZED[0], replace(SQUEEZED[1], value=(0, 0, -6e-3)))
    scene = Scene(
        mesh=MeshSize(largest=0.02),
        geometry=CUBE,
        tissues=(Tissue(poissons_ratio=0.49, mu=(1e3,), alpha=(-25.0,)),),
        displacement_bcs=given,
        quantities=FORCE,
    )
    cache, axes = SolutionCache(ModelHierarchy(scene)), axes_of(scene)
    found = estimate(cache, cheapest(axes), axes["strain"])
    assert found.caution
    small = replace(scene, displacement_bcs=(SQUEEZED[0], replace(SQUEEZED[1], value=(0, 0, -1e-5))))
    assert not estimate(SolutionCache(ModelHierarchy(small)), cheapest(axes), axes["strain"]).caution


def test_a_fold_is_no_estimate() -> None:
    quantity = (Quantity(name="displacement", point=(0, 0, 0.01)),)
    pull = (Traction(boundary="top", value=(0, 0, -1e5)),)
    scene = Scene(
        mesh=MeshSize(largest=0.02),
        geometry=CUBE,
        tissues=(Tissue(poissons_ratio=0.49, mu=(1e3,)),),
        displacement_bcs=SQUEEZED[:1],
        tractions=pull,
        quantities=quantity,
    )
    found = estimate(SolutionCache(ModelHierarchy(scene)), cheapest(axes_of(scene)), axes_of(scene)["strain"])
    assert np.isinf(found.change).all() and "interpreted as finite" in found.caution


def test_elements_in_space_are_judged_in_the_section() -> None:
    """Of a body in space the section's change; what is doubted there is solved for there, and nothing is solved in space."""
    given = (SQUEEZED[0], replace(SQUEEZED[1], value=(0, 0, -2e-3)))
    scene = Scene(
        mesh=MeshSize(largest=0.02),
        geometry=CUBE,
        tissues=(Tissue(poissons_ratio=0.49, mu=(1e3,), alpha=(-19.0,)),),
        displacement_bcs=given,
        quantities=FORCE,
    )
    cache, axes = SolutionCache(ModelHierarchy(scene)), axes_of(scene)
    model = {**cheapest(axes), "strain": "finite", "pressure": "unknown", "space": "solid"}
    plane = {**model, "space": "plane"}
    found = estimate(cache, model, axes["mesh"])
    true = relative_difference(cache(plane).answers, cache({**plane, "mesh": "1"}).answers)
    assert found.method == "in the section" and found.change == pytest.approx(true, rel=0.5) and true[0] > 0.01
    wild = section_estimator(lambda *_: Estimate(np.full(1, 0.01), "guessed", "a guess"))
    solved = wild(cache.solver, model, {**model, "mesh": "1"}, cache)
    assert solved.change == pytest.approx(true) and not solved.caution
    assert all(dict(key)["space"] == "plane" for key in cache.solutions)


def test_elements_that_fold_a_body_without_a_section_are_judged_by_the_linear_one() -> None:
    quantity = (Quantity(name="force", boundary="top"), Quantity(name="force", boundary="front"))
    scene = Scene(
        mesh=MeshSize(largest=0.02),
        geometry=CUBE,
        tissues=(Tissue(mu=(1e3,), poissons_ratio=0.3),),
        displacement_bcs=SQUEEZED,
        quantities=quantity,
    )
    cache, axes = SolutionCache(ModelHierarchy(scene)), axes_of(scene)
    assert "space" not in axes
    model = {**cheapest(axes), "strain": "finite"}
    flat = {**model, "strain": "linear"}
    true = relative_difference(cache(flat).answers, cache({**flat, "order": "2"}).answers)
    folded = section_estimator(lambda *_: Estimate(np.full(2, np.inf), "guessed", "folds"))
    found = folded(cache.solver, model, {**model, "order": "2"}, cache)
    assert found.change[0] == pytest.approx(true[0]) and found.method.startswith("the linear") and abs(true[0]) > 0.05
    assert found.change[1] < 0.05  # the front is free: of the largest reaction, not of nothing
    fine = section_estimator(lambda *_: Estimate(np.full(2, 0.3), "guessed"))
    assert fine(cache.solver, model, {**model, "order": "2"}, cache).method == "guessed"


def test_a_step_on_the_coarsest_elements_is_doubted_where_finer_ones_change_as_much() -> None:
    scene = Scene(
        mesh=MeshSize(largest=0.02),
        geometry=CUBE,
        tissues=(Tissue(poissons_ratio=0.49, mu=(1e3,)),),
        displacement_bcs=SQUEEZED,
        quantities=FORCE,
    )
    cache, axes = SolutionCache(ModelHierarchy(scene)), axes_of(scene)
    model = {**cheapest(axes), "pressure": "unknown"}
    for mesh, doubt in (("0", ""), ("1", "finer elements")):
        found = estimate_linear_coarse(
            cache.solver, {**model, "mesh": mesh}, {**model, "mesh": mesh, "strain": "finite"}, cache
        )
        assert found.change == 0 and found.caution.startswith(doubt) and bool(found.caution) == bool(doubt)
    space = estimate_linear_coarse(
        cache.solver, {**model, "mesh": "1"}, {**model, "mesh": "1", "space": "solid"}, cache
    )
    assert abs(space.change[0]) > 0.05 and not space.caution


def test_what_has_no_answer_is_no_number() -> None:
    """Neither is what a step to it would change."""
    scene = Scene(
        mesh=MeshSize(largest=0.02),
        geometry=CUBE,
        tissues=(Tissue(poissons_ratio=0.49, mu=(1e3,)),),
        displacement_bcs=SQUEEZED,
        quantities=FORCE,
    )
    cache, model = SolutionCache(ModelHierarchy(scene)), cheapest(axes_of(scene))

    def solved(each):
        if each["strain"] == "finite":
            raise SolverError("no step")
        return cache(each)

    found = estimate_by_solution(cache.solver, model, {**model, "strain": "finite"}, solved)
    assert np.isinf(found.change).all() and "no step" in found.caution


@pytest.mark.parametrize("axis", ["inertia", "order", "mesh", "space"])
def test_a_step_of_a_linear_body_in_motion_is_foretold_in_motion(axis: str) -> None:
    given = (DisplacementBC(boundary="bottom"), DisplacementBC(boundary="top", value=(1e-4, 0, 0)))
    course, quantity = Time(ramp=0.01, end=0.01), (Quantity(name="force", boundary="top", direction=(1, 0, 0)),)
    scene = Scene(
        mesh=MeshSize(largest=0.02),
        geometry=CUBE,
        tissues=(Tissue(poissons_ratio=0.49, mu=(1e3,)),),
        displacement_bcs=given,
        time=course,
        quantities=quantity,
    )
    model = {"order": "2", "inertia": "none" if axis == "inertia" else "all"}
    estimated, true = both(scene, model if axis != "order" else {**model, "order": "1", "mesh": "1"}, axis)
    assert abs(true) > 0.03
    assert estimated == pytest.approx(true, rel=1e-3)


def test_a_section_is_doubted_where_finite_strains_change_more_than_leaving_it() -> None:
    for far, doubted in ((5e-3, True), (1e-4, False)):
        given = (SQUEEZED[0], replace(SQUEEZED[1], value=(0, 0, -far)))
        scene = Scene(
            mesh=MeshSize(largest=0.02),
            geometry=CUBE,
            tissues=(Tissue(mu=(1e3,), alpha=(-19.0,), poissons_ratio=0.3),),
            displacement_bcs=given,
            quantities=FORCE,
        )
        model = {**cheapest(axes_of(scene)), "strain": "finite", "order": "2"}
        found = estimate_linear_coarse(
            ModelHierarchy(scene), model, {**model, "space": "solid"}, SolutionCache(ModelHierarchy(scene))
        )
        assert ("finite strains" in found.caution) is doubted


def test_orders_are_judged_in_space_where_strains_are_asked_for() -> None:
    """What a section says of a ball's strains is a cylinder's; of forces it will do."""
    piece = Geometry(kind="block", size=(0.02, 0.02, 0.02), lesion_radius=0.005, lesion_centre=(0, 0, 0.01))
    stuff = (
        Tissue(poissons_ratio=0.49, region="tissue", mu=(1e3,)),
        Tissue(poissons_ratio=0.49, region="lesion", mu=(5e3,)),
    )
    for quantity, how in (
        (Quantity(name="strain", region="lesion", percentile=50), "residual weighted by adjoints"),
        (FORCE[0], "in the section"),
    ):
        scene = Scene(
            mesh=MeshSize(largest=0.02),
            geometry=piece,
            tissues=stuff,
            displacement_bcs=SQUEEZED,
            quantities=(quantity,),
        )
        axes, cache = axes_of(scene), SolutionCache(ModelHierarchy(scene))
        model = {**cheapest(axes), "space": "solid", "strain": "finite", "pressure": "unknown", "tissue": "each"}
        found = estimate(cache, model, axes["order"])
        assert found.method == how
        if quantity.name == "strain":
            true = relative_difference(cache(model).answers, cache({**model, "order": "2"}).answers)[0]
            assert abs(true) > 0.03 and found.change[0] == pytest.approx(true, rel=0.1)
