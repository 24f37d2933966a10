"""The climb: it stops where it may, goes on where it must, and says what it left out."""

import json
from collections.abc import Mapping
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import ngbrain
from ngbrain.errors import InputError
from ngbrain.ladder.axes import AXES, OF_WAVES, Axis, axes_of, cheapest, restrict, richest
from ngbrain.ladder.estimates import ESTIMATORS, SOLVED, Estimate, relative_difference
from ngbrain.ladder.levels import MeshLevel, Model, TimeLevel
from ngbrain.ladder.model_search import (
    _at_least_half_of_order,
    _combine_changes,
    _rung,
    _solve_unreliable,
    _update_from_last_step,
    search_along,
    search_models,
)
from ngbrain.ladder.models.hierarchy import ModelHierarchy, Solution
from ngbrain.ladder.next_step import next_axes
from ngbrain.ladder.quantities import BodyState
from ngbrain.ladder.search_result import Rung
from ngbrain.ladder.solutions import SolutionCache
from ngbrain.result import Status
from ngbrain.scene import DisplacementBC, Geometry, MeshSize, Quantity, Scene, Time, Tissue, Traction

CUBE = Geometry(kind="block", size=(0.02, 0.02, 0.02))
BOUNDS = {"order": "2", "mesh": "1"}


def squeezed(mm: float, stuff: Tissue, tolerance: float = 0.05) -> Scene:
    """A cube between plates that hold it."""
    given = (DisplacementBC(boundary="bottom"), DisplacementBC(boundary="top", value=(0, 0, -mm / 1000)))
    return Scene(
        mesh=MeshSize(largest=0.02),
        geometry=CUBE,
        tissues=(stuff,),
        displacement_bcs=given,
        quantities=(Quantity(name="force", boundary="top", tolerance=tolerance),),
    )


def test_small_strains_stay_linear_and_large_ones_do_not() -> None:
    budday = Tissue(mu=(1e3,), alpha=(-19.0,), poissons_ratio=0.45)
    assert search_models(squeezed(0.02, budday), BOUNDS).chosen.model["strain"] == "linear"
    assert search_models(squeezed(4, budday), BOUNDS).chosen.model["strain"] == "finite"


@pytest.mark.parametrize("tolerance", [0.3, 0.05])
def test_the_chosen_model_is_as_accurate_as_asked(tolerance: float) -> None:
    scene = squeezed(1, Tissue(mu=(1e3,), alpha=(-19.0,), poissons_ratio=0.3), tolerance)
    found = search_models(scene, BOUNDS)
    rich = SolutionCache(ModelHierarchy(scene))(richest(axes_of(scene, BOUNDS)))
    off = np.abs(relative_difference(found.chosen.answers, rich.answers))
    assert off.max() <= tolerance
    assert found.chosen.model != richest(found.axes)
    assert found.error.max() <= tolerance


def test_it_takes_what_gains_most_for_its_cost_and_knows_each_rung() -> None:
    found = search_models(squeezed(2, Tissue(poissons_ratio=0.49, mu=(1e3,))), BOUNDS)
    assert found.history[0].model == cheapest(found.axes)
    for before, after in zip(found.history, found.history[1:], strict=False):
        changed = {name for name in before.model if before.model[name] != after.model[name]}
        assert changed == set(before.next_axes)
        assert after.cost_s > before.cost_s
    assert found.chosen.next_axes == ()
    assert found.usable and repr(found).startswith("SearchResult: ") and f"{len(found.history)} models" in repr(found)


def test_more_missing_than_asked_for_is_said() -> None:
    found = search_models(squeezed(2, Tissue(poissons_ratio=0.49, mu=(1e3,)), 1e-4), {"order": "1", "mesh": "1"})
    assert found.status is Status.INACCURATE and not found.usable and "tolerance 0.01 %" in found.reason


def test_a_course_without_end_is_said_where_nothing_is_richer() -> None:
    found = search_models(squeezed(2, Tissue(poissons_ratio=0.49, mu=(1e3,)), 1e-4), {"order": "1", "mesh": "1"})
    assert any(flag.startswith("mesh") for flag in found.warnings)


def test_a_model_that_is_given_is_not_left() -> None:
    scene = squeezed(2, Tissue(poissons_ratio=0.49, mu=(1e3,)))
    result = ngbrain.simulate(scene, model={"strain": "finite"})
    assert result["model"] == {**cheapest(axes_of(scene)), "strain": "finite"}
    assert len(result["models"]) == 1
    assert {each["axis"] for each in result["left_out"]} == set(result["model"]) - {"strain"}
    with pytest.raises(InputError, match="strian"):
        ngbrain.simulate(scene, model={"strian": "finite"})
    with pytest.raises(InputError, match="linear, finite"):
        ngbrain.simulate(scene, model={"strain": "large"})


def test_axes_are_those_that_mean_something() -> None:
    plain = squeezed(1, Tissue(poissons_ratio=0.49, mu=(1e3,)))
    assert set(axes_of(plain)) == {"strain", "pressure", "space", "order", "mesh"}
    assert "space" not in axes_of(replace(plain, quantities=(Quantity(name="force", boundary="front"),)))
    relaxing = replace(plain, tissues=(Tissue(poissons_ratio=0.49, mu=(1e3, 1e3), eta=(1e3,)),))
    assert "time" in axes_of(relaxing)
    wave = replace(
        plain, time=Time(frequency=50.0), tissues=(Tissue(poissons_ratio=0.49, mu=(1e3,), loss_tangent=0.1),)
    )
    assert set(axes_of(wave)) == {"inertia", "loss", "pressure", "space", "order", "mesh"}
    assert richest(axes_of(plain, BOUNDS))["order"] == "2"
    for bound in ({"oder": "1"}, {"order": "9"}):
        with pytest.raises(InputError, match=r"oder|9"):
            axes_of(plain, bound)


def test_contact_counts_where_tissue_would_slide() -> None:
    scene = squeezed(0.1, Tissue(mu=(1e3,), poissons_ratio=0.3))
    touching = replace(
        scene, displacement_bcs=(scene.displacement_bcs[0], replace(scene.displacement_bcs[1], contact="frictionless"))
    )
    assert "contact" not in axes_of(scene)
    found = search_models(touching, {**BOUNDS, "space": "plane"})
    assert found.chosen.model["contact"] == "all"
    assert (
        abs(next(rung for rung in found.history if "contact" in rung.next_axes).estimates["contact"].change[0]) > 0.03
    )


def test_inertia_counts_where_loads_are_as_fast_as_waves() -> None:
    given = (DisplacementBC(boundary="bottom"), DisplacementBC(boundary="top", value=(1e-5, 0, 0)))
    slow = replace(
        squeezed(0, Tissue(poissons_ratio=0.49, mu=(1e3,))),
        displacement_bcs=given,
        quantities=(Quantity(name="force", boundary="top", direction=(1, 0, 0)),),
    )
    fast = replace(slow, time=Time(ramp=0.01, end=0.01))
    assert "inertia" not in axes_of(slow)
    found = search_models(fast, {"order": "1", "mesh": "0", "space": "plane"})
    assert found.chosen.model["inertia"] == "all"
    before = next(rung for rung in found.history if "inertia" in rung.next_axes)
    assert before.estimates["inertia"].change[0] > 0.3


def test_what_folds_is_no_number_and_solvers_are_heard() -> None:
    quantity = Quantity(name="displacement", point=(0, 0, 0.01))
    scene = replace(
        squeezed(2, Tissue(poissons_ratio=0.49, mu=(1e3,))),
        displacement_bcs=(DisplacementBC(boundary="bottom"),),
        quantities=(quantity,),
    )
    scene = replace(scene, tractions=(Traction(boundary="top", value=(0, 0, -1e5)),))
    result = ngbrain.simulate(scene, model={"order": "1"})
    strain = next(each for each in result["left_out"] if each["axis"] == "strain")
    assert strain["change"] == [None] and "inverts" in strain["caution"] and list(result.errors.values()) == [None]
    far = ngbrain.simulate(
        squeezed(11, Tissue(mu=(1e3,), poissons_ratio=0.3)), model={"order": "2", "strain": "finite"}
    )
    assert any("compressed" in flag for flag in far["cautions"])


def test_what_is_doubted_is_solved_for_before_the_climb_ends() -> None:
    scene = squeezed(1, Tissue(mu=(1e3,), poissons_ratio=0.3))
    cache, axes = SolutionCache(ModelHierarchy(scene)), axes_of(scene)
    model = {**cheapest(axes), "order": "2"}
    wrong = {name: Estimate(np.zeros(1), "guessed", doubt, "finite") for name, doubt in (("strain", "a guess"),)}
    rung = Rung(model, cache(model).answers, 1, wrong, np.zeros(1))
    found = _solve_unreliable(cache, rung, axes)
    true = relative_difference(cache(model).answers, cache({**model, "strain": "finite"}).answers)
    assert found.estimates["strain"].method == "solved" and not found.estimates["strain"].caution
    assert found.error_bound == pytest.approx(np.abs(true)) and abs(true[0]) > 0.005
    trusted = replace(rung, estimates={"strain": Estimate(np.zeros(1), "guessed", "", "finite")})
    assert _solve_unreliable(cache, trusted, axes).error_bound == 0


def test_memory_is_judged_by_its_richest_level() -> None:
    scene = squeezed(1, Tissue(poissons_ratio=0.49, mu=(1e3, 1e3), eta=(1e3,)))
    time = axes_of(scene)["time"]
    assert [time.estimated_level(level) for level in time.levels[:-1]] == ["relaxed", "flowing", "flowing"]
    assert axes_of(scene, {"time": "prony"})["time"].estimated_level("relaxed") == "prony"


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"strain": 0.03, "fibres": 0.01}, 0.04),  # of one sign
        ({"strain": 0.03, "fibres": -0.01}, 0.02),  # of either
        ({"strain": 0.03, "fibres": -0.029}, 0.5 * np.hypot(0.03, 0.029)),  # that cancel: half of what chance leaves
        ({"order": -0.03, "mesh": 0.01}, 0.03),  # two of the same error
        ({"strain": np.inf, "fibres": 0.01}, np.inf),
    ],
)
def test_changes_add_up_with_their_signs(changes, expected):
    axes = {name: SimpleNamespace(tail=1.0) for name in changes}
    estimates = {name: Estimate(np.array([change]), "") for name, change in changes.items()}
    rung = _combine_changes(Rung({}, np.ones(1), 1, estimates, np.zeros(1)), axes)
    assert rung.expected == pytest.approx(expected)
    assert rung.error_bound == pytest.approx(
        max(map(abs, changes.values())) if "mesh" in changes else sum(map(abs, changes.values()))
    )


def test_elements_come_after_what_cannot_be_left_out() -> None:
    """However much they change; not after what may be left out."""
    axes = axes_of(squeezed(1, Tissue(poissons_ratio=0.49, mu=(1e3,))))
    changes = {"strain": 0.06, "mesh": 0.9, "pressure": 0.01}
    rung = Rung(cheapest(axes), np.ones(1), 1, {k: Estimate(np.full(1, v), "") for k, v in changes.items()}, np.ones(1))
    above = {name: axes[name] for name in changes}
    assert next_axes(above, rung, np.full(1, 0.05)) == ("strain",)
    assert next_axes(above, rung, np.full(1, 0.1)) == ("mesh",)


@pytest.mark.parametrize(
    ("changes", "taken", "left"),
    [
        ({"order": 0.02, "mesh": 0.03}, "mesh", max(0.25 * 0.03 * 1.6, 0.5 * 0.02 * 1.3)),
        ({"order": 0.07, "mesh": 0.04}, "order", max(0.25 * 0.07 * 1.3, 0.04 * 1.6)),
    ],
)
def test_elements_get_finer_in_both_ways_where_one_would_leave_too_much(
    changes: dict[str, float], taken: str, left: float
) -> None:
    """A quarter of itself or what the other way then changes: half of it once elements are halved, all at a higher order."""
    axes = axes_of(squeezed(1, Tissue(poissons_ratio=0.49, mu=(1e3,))))
    above = {name: axes[name] for name in changes}
    estimates = {name: Estimate(np.full(1, change), "") for name, change in changes.items()}
    rung = Rung(cheapest(axes), np.ones(1), 1, estimates, np.ones(1))
    assert next_axes(above, rung, np.full(1, 1.01 * left)) == (taken,)
    both = next_axes(above, rung, np.full(1, 0.99 * left))
    assert both[0] == taken and set(both) == set(changes)


def test_waves_take_one_step_to_finer_elements_at_a_time() -> None:
    """Of higher order they cost a tenth of those that are smaller too."""
    changes = {"order": 0.08, "mesh": 0.05}
    for axes, taken in ((OF_WAVES, ("order",)), (AXES, ("order", "mesh"))):
        estimates = {name: Estimate(np.full(1, change), "") for name, change in changes.items()}
        rung = Rung({"order": "1", "mesh": "0"}, np.ones(1), 1, estimates, np.ones(1))
        assert next_axes({name: axes[name] for name in changes}, rung, np.full(1, 0.05)) == taken


class Written:
    """Answers by the elements alone; of the model that flows it keeps which were asked for."""

    def __init__(self, answers: dict[tuple[str, str], float]) -> None:
        self.answers, self.flowed = answers, list[tuple[str, str]]()

    def solve(self, model: Model, near: Mapping[str, BodyState] | None = None) -> Solution:
        elements = model["order"], model["mesh"]
        if model["time"] == "flowing":
            self.flowed.append(elements)
        return Solution(np.array([self.answers[elements]]), {}, 1, 0.0)


def test_elements_that_are_only_halved_as_a_whole_are_not_climbed_one_way_after_the_other() -> None:
    """Where one way is not enough: the step between costs a third of the richest model, and is left again."""
    axes = {name: restrict(replace(AXES[name], by=("forgetful",) * 4), 0, 2) for name in ("order", "mesh")}
    axes["mesh"] = replace(axes["mesh"], levels=(MeshLevel.COARSEST, MeshLevel.HALVED))
    axes["time"] = Axis("time", (TimeLevel.FLOWING,), (), (), ())
    for tolerance, way in ((0.05, [("1", "0"), ("2", "1")]), (0.07, [("1", "0"), ("2", "0")])):
        bench = Written({("1", "0"): 1.11, ("2", "0"): 1.04, ("1", "1"): 1.07, ("2", "1"): 1.0})
        found = search_along(axes, SolutionCache(bench), np.full(1, tolerance), lambda _: None)
        assert bench.flowed == way
        assert abs(found.chosen.answers[0] - 1) <= tolerance


TOLERANCE = np.full(1, 0.05)


def guessed(*change: float) -> Estimate:
    return Estimate(np.array(change), "guessed")


def solid(answers: list[float], taken: tuple[str, ...] = (), **estimates: Estimate) -> Rung:
    """A rung in space."""
    model = {**cheapest(axes_of(squeezed(1, Tissue(poissons_ratio=0.49, mu=(1e3,))))), "space": "solid"}
    missing = np.sum([np.abs(each.change) for each in estimates.values()], axis=0)
    return Rung(model, np.array(answers), 1, estimates, missing, taken)


def test_what_finer_elements_change_is_no_less_than_a_part_of_the_last_step() -> None:
    """Where the section says next to nothing; not of a body of the plane, nor less than what is estimated."""
    axes = axes_of(squeezed(1, Tissue(poissons_ratio=0.49, mu=(1e3,))))
    for taken, floor in ((("mesh",), -0.02), (("order", "mesh"), -0.005), (("strain",), -0.001)):
        before = solid([1.0], taken, **dict.fromkeys(taken, guessed(-0.1)))
        for guess in (-0.001, -0.5):
            found = _update_from_last_step(solid([0.92], order=guessed(guess)), [before], axes, TOLERANCE)
            change = min(floor, guess)
            assert found.estimates["order"].change[0] == pytest.approx(change) and not found.estimates["order"].caution
            assert found.error_bound[0] == pytest.approx(-change * (1 if floor >= guess else axes["order"].tail))
    before = solid([1.0, 1.0], ("mesh",), mesh=guessed(-0.1, 0.0))
    found = _update_from_last_step(solid([0.92, 1.0], order=guessed(0.001, 0.3)), [before], axes, np.full(2, 0.05))
    assert found.estimates["order"].change == pytest.approx([-0.02, 0.3])
    before.model["space"] = "plane"
    rung = solid([0.92], order=guessed(0.001))
    assert _update_from_last_step(rung, [before], axes, TOLERANCE) is rung


@pytest.mark.parametrize(
    ("told", "after", "doubted"), [(-0.1, 1.04, True), (-0.1, 0.92, False), (-0.1, 1.01, False), (-0.01, 1.04, False)]
)
def test_elements_that_changed_the_answer_the_other_way_than_foretold_are_doubted(
    told: float, after: float, doubted: bool
) -> None:
    """By more than a quarter of the tolerance, both."""
    axes = axes_of(squeezed(1, Tissue(poissons_ratio=0.49, mu=(1e3,))))
    before = solid([1.0], ("mesh",), mesh=guessed(told))
    found = _update_from_last_step(solid([after], order=guessed(0.3), mesh=guessed(0.3)), [before], axes, TOLERANCE)
    assert [bool(found.estimates[name].caution) for name in ("order", "mesh")] == [doubted] * 2


class Asked:
    """Keeps what its solutions were to start from."""

    def __init__(self) -> None:
        self.near = list[object]()

    def solve(self, model: Model, near: Mapping[str, BodyState] | None = None) -> Solution:
        self.near.append(near)
        return Solution(np.ones(1), {"end": object()}, 1, 0.0)  # type: ignore[dict-item]


@pytest.mark.parametrize(("contact", "starts"), [("none", [False, True, True]), ("all", [False, False, True])])
def test_finite_strains_start_from_the_model_that_is_most_like_them(contact: str, starts: list[bool]) -> None:
    """What slides, in the same elements only."""
    bench = Asked()
    cache = SolutionCache(bench)
    model = {"strain": "finite", "contact": contact, "space": "solid", "order": "1", "mesh": "0", "tissue": "one"}
    for change in ({}, {"mesh": "1"}, {"mesh": "1", "tissue": "each"}):
        cache({**model, **change})
    assert [near is not None for near in bench.near] == starts


class Stiff:
    """Pressures change more than what elements are said to."""

    def solve(self, model: Model, near: Mapping[str, BodyState] | None = None) -> Solution:
        finer = 0.01 * (model["mesh"] == "1") + 0.02 * (model["order"] == "2")
        return Solution(np.array([1.0 + finer - 0.04 * (model["pressure"] == "unknown")]), {}, 1, 0.0)


def test_elements_that_may_lock_are_doubted_and_solved_for_before_a_climb_ends() -> None:
    """Not once pressures are unknowns."""
    axes = {name: restrict(replace(OF_WAVES[name], by=("solve",) * 4), 0, 2) for name in ("pressure", "order", "mesh")}
    axes |= {name: replace(axes[name], by=("roundly",)) for name in ("order", "mesh")}
    model = {"pressure": "none", "order": "1", "mesh": "0"}
    cache = SolutionCache(Stiff())
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(ESTIMATORS, "roundly", lambda bench, one, other, solved: guessed(0.005))
        found = _rung(cache, model, axes).estimates
        assert [bool(found[name].caution) for name in axes] == [False, True, True]
        elements = {name: axes[name] for name in ("order", "mesh")}
        assert not any(
            each.caution for each in _rung(cache, {**model, "pressure": "unknown"}, elements).estimates.values()
        )
        climbed = search_along(axes, cache, np.full(1, 0.1), lambda _: None).chosen
    assert climbed.model == model and {each.method for each in climbed.estimates.values()} == {SOLVED}


def test_halved_elements_change_at_least_half_of_what_a_higher_order_does() -> None:
    """Both are of the same error. Where they were made smaller in parts, what is left is less."""
    order, mesh = (
        Estimate(np.array([0.07, -0.02]), "in the section"),
        Estimate(np.array([0.016, 0.03]), "in the section", "doubted"),
    )
    found = _at_least_half_of_order(mesh, order)
    assert found.change == pytest.approx([0.035, 0.03]) and found.caution == "doubted" and "half" in found.method
    assert _at_least_half_of_order(replace(mesh, method=SOLVED), order).method == SOLVED
    assert _at_least_half_of_order(mesh, replace(order, change=np.array([0.03, 0.06]))) is mesh
    assert _at_least_half_of_order(mesh, replace(order, change=np.array([np.inf, 0.0]))) is mesh


def test_what_comes_near_the_tolerance_is_said() -> None:
    scene = squeezed(1, Tissue(mu=(1e3,), alpha=(-19.0,), poissons_ratio=0.3))
    missing = search_models(scene, BOUNDS).error[0]
    for share, said in ((0.9, "close to"), (0.5, "")):
        asked = replace(scene, quantities=(replace(scene.quantities[0], tolerance=float(missing / share)),))
        found = search_models(asked, BOUNDS)
        assert found.error[0] == pytest.approx(missing)
        assert any("estimated error" in flag and said in flag for flag in found.warnings) == bool(said)


def test_an_axis_that_is_bounded_by_its_cheapest_level_stays_there() -> None:
    scene = squeezed(1, Tissue(poissons_ratio=0.49, mu=(1e3,)))
    axes = axes_of(scene, {"pressure": "none", "strain": "linear"})
    assert axes["pressure"].levels == ("none",) and axes["strain"].levels == ("linear",)
    assert {**cheapest(axes), **richest(axes)}.items() >= {"pressure": "none", "strain": "linear"}.items()


def test_what_is_stopped_leaves_what_it_has(tmp_path):
    """After the first model its answers, its error and that another was under way are in the file."""
    seen = []

    def stop(result):
        seen.append(result)
        raise KeyboardInterrupt

    scene = Scene(
        geometry=Geometry(kind="block", size=(0.02, 0.02, 0.02)),
        mesh=MeshSize(largest=0.02),
        tissues=[Tissue(mu=1e3, poissons_ratio=0.3)],
        displacement_bcs=[DisplacementBC(boundary="bottom"), DisplacementBC(boundary="top", value=(0, 0, -4e-3))],
        quantities=[Quantity(name="force", boundary="top", tolerance=0.05)],
    )
    with pytest.raises(KeyboardInterrupt):
        ngbrain.simulate(scene, tmp_path, checkpoint=stop)
    left = json.loads((tmp_path / "result.json").read_text())
    assert left == json.loads(json.dumps(seen[0])) and len(left["models"]) == 1
    assert left["answers"][0]["value"] < 0 and any("not final" in flag for flag in left["cautions"])
    whole = ngbrain.simulate(scene, tmp_path)
    assert not any("not final" in flag for flag in whole["cautions"]) and len(whole["models"]) > 1
