"""Scenes drawn at random: what the ladder answers, what it states as error, and what it flags, against judges of their own.

Every tenth scene is a bar on rollers, whose force has a closed form; the others are judged by the richest model that they may climb
to.
An answer without a flag must hold its tolerance, and a stated error must be near the true one.
"""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.optimize import brentq

from ngbrain.errors import SolverError
from ngbrain.ladder.axes import axes_of
from ngbrain.ladder.estimates import relative_difference
from ngbrain.ladder.model_search import search_models
from ngbrain.ladder.models.hierarchy import ModelHierarchy
from ngbrain.ladder.solutions import SolutionCache
from ngbrain.scene import DisplacementBC, Geometry, MeshSize, Quantity, Scene, Time, Tissue, Traction

TOLERANCE = 0.1
FAST = (*range(0, 80, 10), 6, 8, 12, 16, 155)
"""Seeds of cheap ones, and of a column under shear."""
SLOW = range(200)
FIRST_GUESSES = (12, 16, 155)
RICHEST = {"mesh": "1"}
"""So that the richest model takes a few seconds."""
ROLLERS = (
    DisplacementBC(boundary="left", components="x"),
    DisplacementBC(boundary="front", components="y"),
    DisplacementBC(boundary="bottom", components="z"),
)


@dataclass(frozen=True)
class Outcome:
    """Of one scene: how far off, what was stated, and whether it was flagged."""

    seed: int
    error: float
    stated: float
    flags: list[str]


def bar(rng):
    """A bar on rollers, pulled or pressed along z, and the force (N) on its top."""
    size = tuple(rng.uniform(0.01, 0.03, 3))
    mu, nu, stretch = 10 ** rng.uniform(2.5, 4), rng.uniform(0.2, 0.49), rng.uniform(0.8, 1.2)
    given = (*ROLLERS, DisplacementBC(boundary="top", value=(0, 0, (stretch - 1) * size[2]), components="z"))
    cell = 0.9 * min(size)
    scene = Scene(
        mesh=MeshSize(largest=cell),
        geometry=Geometry(kind="block", size=size),
        tissues=(Tissue(mu=(mu,), poissons_ratio=nu),),
        displacement_bcs=given,
        quantities=(Quantity(name="force", boundary="top"),),
    )
    bulk = 2 * mu * (1 + nu) / (3 * (1 - 2 * nu))

    def stresses(across):
        # W = μ/2 (J^(-2/3) Σλ² - 3) + K/2 (J - 1)², stretches (across, across, stretch): the two ∂W/∂λ
        J, squares = stretch * across**2, stretch**2 + 2 * across**2
        volume = bulk * (J - 1) - mu / 3 * J ** (-5 / 3) * squares
        return mu * J ** (-2 / 3) * np.array([across, stretch]) + volume * np.array([across * stretch, across**2])

    across = brentq(lambda x: stresses(x)[0], 0.5, 1.6, xtol=1e-14)
    return scene, np.array([stresses(across)[1] * size[0] * size[1]])


def drawn(seed):
    """A scene: size, tissue, supports, loads and question at random."""
    rng = np.random.default_rng([11, seed])
    size = tuple(rng.uniform(0.012, 0.03, 3))
    mu, nu = 10 ** rng.uniform(2.5, 4), rng.choice([0.3, 0.45, 0.49])
    stuff = {"mu": (mu,), "poissons_ratio": float(nu)}
    kind = rng.choice(["plain", "fibres", "relaxing"])
    if kind == "fibres":
        stuff |= {
            "fibre_stiffness": mu * rng.uniform(0.2, 2),
            "fibre_exponent": rng.uniform(0.5, 10),
            "fibre": tuple(rng.normal(size=3)),
        }
    if kind == "relaxing":
        stuff |= {"mu": (mu, mu * rng.uniform(0.3, 2)), "tau": (10 ** rng.uniform(-1, 2),)}
    course = {"ramp": float(10 ** rng.uniform(-0.5, 1)), "end": float(10 ** rng.uniform(1.1, 2.5))}
    way = rng.normal(size=3) * [0.5, 0.5, 1]
    way *= rng.uniform(0.01, 0.12) * size[2] / np.abs(way).max()
    given, pull = [DisplacementBC(boundary="bottom")], []
    if rng.random() < 0.6:
        given.append(DisplacementBC(boundary="top", value=tuple(way)))
    else:
        pull.append(Traction(boundary="top", value=tuple(way / size[2] * mu)))
        if rng.random() < 0.3:  # where both are driven, forces at their edge have no limit
            given.append(DisplacementBC(boundary="left", components="y"))
    axis = int(np.abs(way).argmax())
    along = tuple(float(i == axis) for i in range(3))
    top = (0.0, 0.0, float(size[2]))
    if pull:
        quantity = Quantity(name="displacement", point=top, direction=along, tolerance=TOLERANCE)
    elif rng.random() < 0.3:
        quantity = Quantity(name="strain", percentile=90, tolerance=TOLERANCE)
    else:
        quantity = Quantity(name="force", boundary="top", direction=along, tolerance=TOLERANCE)
    piece = Geometry(kind="block", size=size)
    return Scene(
        mesh=MeshSize(largest=0.8 * max(size)),
        geometry=piece,
        tissues=(Tissue(**stuff),),
        displacement_bcs=tuple(given),
        tractions=tuple(pull),
        time=Time(**course),
        quantities=(quantity,),
    )


def outcome(seed):
    """One scene climbed and judged; None where even its judge finds no equilibrium."""
    if seed % 10 == 0:
        scene, truth = bar(np.random.default_rng([12, seed]))
        scene = replace(scene, quantities=(replace(scene.quantities[0], tolerance=TOLERANCE),))
        found = search_models(scene)
    else:
        scene = drawn(seed)
        axes = axes_of(scene, RICHEST)
        try:
            truth = SolutionCache(ModelHierarchy(scene))({name: axis.levels[-1] for name, axis in axes.items()}).answers
        except SolverError:
            return None
        found = search_models(scene, RICHEST)
    error = float(np.abs(relative_difference(found.chosen.answers, truth)).max())
    return Outcome(seed, error, float(found.error.max()), list(found.warnings))


def check(outcomes):
    """What has to hold of all of them."""
    for each in outcomes:
        print(each)
    silent = [each for each in outcomes if not each.flags]
    assert all(each.error <= 1.5 * TOLERANCE for each in silent)
    assert sum(each.error <= TOLERANCE for each in silent) >= 0.97 * len(silent)
    assert len(silent) >= 2 / 3 * len(outcomes)


def test_answers_hold_what_they_state():
    found = [each for seed in FAST if (each := outcome(seed))]
    assert len(found) == len(FAST)
    check(found)


@pytest.mark.xfail(
    strict=True,
    raises=AssertionError,
    reason="climbs begin below what an expert would: start and order are to be chosen anew with the scene",
)
def test_an_answer_takes_hardly_more_unknowns_than_an_experts_first_guess():
    """Elements of third order on the coarsest mesh, nothing left out; it meets the tolerance in all of these."""
    dearer = []
    for seed in FIRST_GUESSES:
        scene = drawn(seed)
        best = {name: axis.levels[-1] for name, axis in axes_of(scene, RICHEST).items()}
        guess, cache = SolutionCache(ModelHierarchy(scene)), SolutionCache(ModelHierarchy(scene))
        first, truth = guess({**best, "mesh": "0", "order": "2"}), guess(best)
        if np.abs(relative_difference(first.answers, truth.answers)).max() > TOLERANCE:
            raise ValueError("the first guess does not meet the tolerance")
        search_models(scene, RICHEST, cache=cache)
        dearer.append(sum(found.ndof for found in cache.solutions.values()) / first.ndof)
    print(dearer)
    assert np.median(dearer) < 1.2


@pytest.mark.slow
def test_two_hundred_scenes():
    found = [each for seed in SLOW if (each := outcome(seed))]
    assert len(found) >= 0.95 * len(SLOW)
    check(found)
    judged = [each.stated / each.error for each in found if each.error > 0.1 * TOLERANCE and np.isfinite(each.stated)]
    near = np.mean([0.3 <= ratio <= 3 for ratio in judged])
    print(
        f"stated over true, of {len(judged)} errors: {np.quantile(judged, [0.05, 0.5, 0.95]).round(2)}; near: {near:.2f}"
    )
    assert np.quantile(judged, 0.02) > 0.3 and near >= 0.9
