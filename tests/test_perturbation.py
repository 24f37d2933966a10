"""The options `--perturb` and `--ngs-threads`: what they move, by how much, and that nothing moves unasked."""

import subprocess
import sys
from pathlib import Path

import ngsolve as ngs
import numpy as np
import pytest
from netgen import occ
from parallel_tasks import points
from perturbation import DRAWN, moved

from ngbrain import parallel
from ngbrain.forward.common.material import Material
from ngbrain.forward.harmonic.problem import HarmonicProblem
from ngbrain.forward.harmonic.wave import Wave
from ngbrain.forward.solid.problem import Problem
from ngbrain.materials import NeoHooke, Prony, Shearing
from ngbrain.mesh import block
from ngbrain.mesh.geometry.structured import rectangles
from ngbrain.surgery.protocols import continuous_retraction

MOST = (DRAWN + 1) * np.finfo(float).eps


def test_values_move_by_a_few_last_places_and_always_alike(rng):
    values = rng.normal(size=(1000, 3)) * 10.0 ** rng.integers(-9, 9, size=(1000, 1))
    for together in (False, True):
        there = moved(values, 1, together)
        assert np.abs(there / values - 1).max() < MOST and np.mean(there != values) > 0.8
        np.testing.assert_array_equal(moved(there, 1, together), there)
        np.testing.assert_array_equal(moved(values[::-1], 1, together)[::-1], there)
        assert np.mean(moved(values, 2, together) != there) > 0.8
    assert len(np.unique(moved(np.column_stack([np.ones(50), np.arange(50)]), 1, together=True)[:, 0])) > 5
    assert np.iscomplexobj(moved([1.1 + 2.3j], 3)) and 0 < abs(moved([1.1 + 2.3j], 3)[0] - (1.1 + 2.3j)) < 1e-14


def test_what_has_no_last_places_stays():
    still = np.array([0.0, -0.0, np.inf, -np.inf, np.nan])
    assert moved(still, 1).tobytes() == still.tobytes()


def of_a_mesh():
    raw = occ.OCCGeometry(occ.Box((1, 1, 1), (2, 3, 4))).GenerateMesh(maxh=2.0)
    given = raw.Coordinates().copy()
    return given, ngs.Mesh(raw).ngmesh.Coordinates().copy()


def relaxing():
    tissue = {".*": Material(Prony(NeoHooke(1e3), [0.5], [1.0]), 1e5)}
    return Problem(block((0.1, 0.1, 0.1), 0.1), tissue, {"bottom": 0, "top": (0, 0.1, -0.3)}, element="P2/P1")


def of_loads():
    body = relaxing()
    x, held = body.load(np.zeros(body.fes.ndof), 0.7), np.flatnonzero(body.fixed)
    return [0.7, *0.7 * body.prescribed[held]], [body.factor.Get(), *x[held]]


def of_times():
    history, steps = relaxing().history, np.geomspace(1e-3, 1e3, 50)
    found = []
    for dt in steps:
        history.begin(dt)
        found.append(history.dt)
    return steps, found


def of_waves():
    mesh, ends = rectangles(np.linspace(0, 0.1, 3), np.linspace(0, 0.1, 3)), (1e-3, 3e-3)
    body = HarmonicProblem(
        mesh, Shearing(2000 + 800j), [Wave(50.0, {"top": ends})], bulk=2e5, dirichlet="top|bottom", form="Q1"
    )
    found = body.prescribed[0]
    return np.where(found.real > 2e-3, 3e-3, 1e-3)[found != 0], found[found != 0].real


def of_blades():
    times, opening = np.linspace(0.1, 60, 50), 5e-3
    drive = continuous_retraction(opening, 10.0, 60.0)
    return np.interp(times, [0.0, 10.0], [0.0, opening]), [drive.value(t) for t in times]


@pytest.mark.parametrize("of", [of_a_mesh, of_loads, of_times, of_waves, of_blades])
def test_inputs_move_if_asked(of, pytestconfig):
    given, found = map(np.array, of())
    assert given.shape == found.shape and given.size
    assert np.all(np.abs(found - given) <= MOST * np.abs(given))
    assert np.array_equal(found, given) == (pytestconfig.getoption("perturb") is None)


def test_other_processes_move_theirs_alike():
    found = parallel.run([(name, points, ()) for name in "ab"], 2)
    for name in "ab":
        np.testing.assert_array_equal(found[name], points(callback=print))


def test_threads_are_those_asked_for(pytestconfig):
    assert ngs.ngsglobals.numthreads == pytestconfig.getoption("ngs_threads")


@pytest.mark.one_thread
def test_what_holds_on_one_thread_gets_one():
    assert ngs.ngsglobals.numthreads == 1


def test_the_options_are_heard():
    root = Path(__file__).parents[1]
    asked = [
        "--perturb",
        "7",
        "--ngs-threads",
        "2",
        "-k",
        "of_loads or threads_are or one_thread",
        "-p",
        "no:cacheprovider",
        "-q",
    ]
    done = subprocess.run(
        [sys.executable, "-m", "pytest", __file__, *asked], cwd=root, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0 and "3 passed" in done.stdout, done.stdout
