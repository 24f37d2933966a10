"""Observables of one's own as questions: a ladder asks them like its scene's, and says what they are of."""

from dataclasses import dataclass

import numpy as np
import pytest

import ngbrain
from ngbrain import ladder
from ngbrain.errors import InputError
from ngbrain.forward.observables import Displacements, Force, Functional, Observable, StrainPercentile, region_volume
from ngbrain.forward.observables.base import LinearObservable
from ngbrain.ladder import Question
from ngbrain.ladder.axes import axes_of, cheapest
from ngbrain.ladder.models.bodies import SMALL, linear_state
from ngbrain.ladder.models.hierarchy import ModelHierarchy, solve
from ngbrain.ladder.quantities import BodyState, evaluate, gradient
from ngbrain.report.pages.ladder import answers
from ngbrain.scene import DisplacementBC, Geometry, MeshSize, Quantity, Scene, Time, Tissue
from ngbrain.scene.quantities import OF_BODIES, OF_OPERATIONS
from ngbrain.surgery.quantities import QUANTITIES

POINT = (0.01, 0.0, 0.02)
PRESSED = (DisplacementBC(boundary="bottom"), DisplacementBC(boundary="plate", value=(0, 0, -1e-3)))
SCENE = Scene(
    mesh=MeshSize(largest=0.015),
    geometry=Geometry(kind="block", size=(0.04, 0.04, 0.02), plate=(0.02, 0.02)),
    tissues=(Tissue(mu=(1e3,), poissons_ratio=0.45),),
    displacement_bcs=PRESSED,
    quantities=(Quantity(name="displacement", point=POINT, direction=(0, 0, 1), tolerance=0.3),),
)
BOUNDS = {"order": "1", "mesh": "0"}


@dataclass(frozen=True)
class Drop(Observable):
    """How far a point goes down (m), of a user's own."""

    point: tuple[float, ...]
    unit = "m"
    name = "drop of a point"

    def on(self, problem):
        return LinearObservable(problem, Displacements([self.point], (0, 0, -1)).on(problem).matrix)


def test_a_users_own_is_answered_as_the_scenes_own_questions_are():
    result = ngbrain.simulate(SCENE, richest=BOUNDS, questions=[Question(Drop(POINT), tolerance=0.3)])
    asked, own = result["answers"]
    assert own["value"] == pytest.approx(-asked["value"]) and own["value"] > 0
    assert own["error_estimate"] == pytest.approx(asked["error_estimate"])
    assert own["unit"] == asked["unit"] == "m" and own["quantity"] == "drop of a point, end"
    assert result.value[own["quantity"]] == own["value"] and result["model"].get("space", "solid") == "solid"
    assert [row[1].split()[1] for row in answers(result)] == ["mm", "mm"]
    assert all("plane" not in rung["model"].values() for rung in result["models"])  # a section has no y


def test_units_of_a_scenes_quantities_are_those_of_what_they_are():
    kinds = {"force": Force, "displacement": Displacements, "strain": StrainPercentile}
    for name in OF_BODIES:
        assert Quantity(name=name).unit == kinds[name].unit
    for name in OF_OPERATIONS:
        assert Quantity(name=name).unit == QUANTITIES[name].unit


def test_what_is_not_linear_counts_linearly_where_strains_are_small(rng):
    """A volume is V + V'u of small strains; its slope is that of the answer."""
    volume, bench = Question(region_volume()), ModelHierarchy(SCENE, [Question(region_volume())])
    model = {**cheapest(axes_of(SCENE, questions=[volume])), "order": "2"}
    body = bench.static(model, 1.0)
    state = BodyState(body, linear_state(body), SMALL, True)
    rest = 0.04 * 0.04 * 0.02
    found = evaluate(volume, state)
    assert 0 < rest - found < 0.02 * 0.02 * 1e-3  # less than what the plate sweeps: it bulges
    assert found == pytest.approx(rest + evaluate(Question(SWELLING), state), rel=1e-6)
    change = 1e-3 * state.x * (body.weights > 0) * rng.uniform(0.5, 1.5, len(state.x))
    after = evaluate(volume, BodyState(body, state.x + change, SMALL, True))
    assert gradient(volume, state) @ change == pytest.approx(after - found, rel=1e-3)


SWELLING = Functional(lambda at: (at.F[0, 0] + at.F[1, 1] + at.F[2, 2] - 3) * at.dx(".*"), name="swelling")


def test_forces_of_finite_strain_and_through_time():
    force, own = Quantity(name="force", boundary="plate"), Question(Force("plate", (0, 0, 1)))
    relaxing = Scene(
        geometry=SCENE.geometry,
        mesh=SCENE.mesh,
        tissues=(Tissue(mu=(1e3, 500.0), eta=(500.0,), poissons_ratio=0.45),),
        displacement_bcs=PRESSED,
        time=Time(ramp=1.0, end=5.0),
        quantities=(force,),
    )
    axes = axes_of(relaxing, questions=[own])
    assert "space" not in axes and "extent" not in axes
    for levels in ({"strain": "finite"}, {"time": "prony"}):
        bench = ModelHierarchy(relaxing, [own])
        asked, mine = solve(bench, {**cheapest(axes), **levels}).answers
        assert mine == pytest.approx(asked) and asked < 0, levels


def test_what_is_no_question_is_refused():
    for of in (
        lambda: Question("force"),
        lambda: Question(region_volume(), tolerance=2.0),
        lambda: Question(region_volume(), when="later"),
        lambda: ModelHierarchy(SCENE, [Question(region_volume()), Question(region_volume())]),
        lambda: ModelHierarchy(SCENE, [Question(Force("plate"))]).solve({**cheapest(axes_of(SCENE)), "space": "solid"}),
        lambda: ladder.solve(SCENE, model={"space": "plane"}, questions=[Question(region_volume())]),
    ):
        with pytest.raises(InputError, match=r"question|Question|space"):
            of()
    wave = Scene(
        tissues=SCENE.tissues,
        displacement_bcs=PRESSED,
        geometry=SCENE.geometry,
        mesh=SCENE.mesh,
        time=Time(frequency=50.0),
        quantities=SCENE.quantities,
    )
    with pytest.raises(InputError, match="harmonic problem"):
        ModelHierarchy(wave, [Question(region_volume())])
    assert np.isfinite(Question(region_volume()).tolerance)
