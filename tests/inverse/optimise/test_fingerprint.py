"""Fingerprint of a problem: each changed part is named, and no other."""

from dataclasses import replace
from functools import cache

import ngsolve as ngs
import numpy as np
import pytest

from ngbrain.adjoint.reduced import Reduced
from ngbrain.forward.sensitivity.harmonic.wave_model import BOUNDARY
from ngbrain.inverse.data.quality import noise_deviation
from ngbrain.inverse.objective.misfit import Huber, LeastSquares
from ngbrain.inverse.objective.parameters import ParameterFields
from ngbrain.inverse.objective.regularisers import resolve_priors
from ngbrain.inverse.optimise.fingerprint import differing_parts, problem_fingerprint
from ngbrain.inverse.problem.discretisation import discretise
from ngbrain.inverse.problem.properties import material_properties
from ngbrain.inverse.problem.property_fields import FieldPerLabel
from ngbrain.inverse.problem.wave_problem import ElastographyProblem
from ngbrain.io.waves import WaveData

START, MATERIAL = "unknowns or their start", ["material, density or fibres"]


@cache
def data():
    """A body of fibres in the plane, with two labels."""
    line = np.linspace(0, 0.036, 10)
    points = np.array([[x, y] for y in line for x in line])
    k = 2 * np.pi * 80 * np.sqrt(1000 / (2500 + 800j))
    u = 1e-5 * np.stack([np.exp(-1j * k * points[:, i]) for i in (1, 0)], axis=1)[None]
    labels = (points[:, 0] > 0.018).astype(int)
    fibre = np.tile([1.0, 0.0], (100, 1))
    return WaveData(
        points, u, [80.0], 1000.0, "transversely_isotropic", "viscoelastic", bulk=2e4, fibre=fibre, labels=labels
    )


def problem(waves, noise=0.02, order=3, prior="smooth", labelled=False, misfit=LeastSquares, start=2000.0):
    elements = discretise(waves, order)
    composition = FieldPerLabel(waves, elements) if labelled else None
    experiment = ElastographyProblem(waves, elements, material_properties(waves, start), composition)
    sigma = noise_deviation(waves, noise)
    unknowns = experiment.unknowns(sigma)
    ((_, make),) = resolve_priors(prior).items()
    blocks = {name: block for name, block in unknowns.blocks.items() if name != "boundary"}
    regular = {name: make(experiment.space, unknowns.start[block]) for name, block in blocks.items()}
    return Reduced(experiment.model, misfit(experiment.measured, sigma), unknowns, regular, dict.fromkeys(regular, 1e3))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({}, []),
        ({"bulk": 2.002e4}, MATERIAL),
        ({"density": 1001.0}, MATERIAL),
        ({"fibre": np.tile([0.8, 0.6], (100, 1))}, MATERIAL),
        ({"frequency": np.array([81.0])}, ["frequencies", *MATERIAL]),
        ({"displacement": data().displacement * 1.001}, ["measured displacements"]),
        ({"rheology": "elastic"}, [START, *MATERIAL, "regularisers"]),
    ],
    ids=["same", "bulk", "density", "fibre", "frequency", "displacement", "law"],
)
def test_other_data(changes, words):
    found = differing_parts(
        problem_fingerprint(problem(replace(data(), **changes))), problem_fingerprint(problem(data()))
    )
    assert set(words) <= set(found) and ("frequencies" in found) == ("frequencies" in words)
    assert bool(found) == bool(words)


def test_last_bits_do_not_matter():
    """Sums of several threads differ in the last bits."""
    almost = replace(data(), bulk=2e4 * (1 + 1e-13))
    assert not differing_parts(
        problem_fingerprint(problem(almost, start=2000.0 * (1 + 1e-13))), problem_fingerprint(problem(data()))
    )


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"misfit": Huber}, ["their noise"]),
        ({"prior": "edges"}, ["regularisers"]),
        ({"noise": 0.03}, ["their noise"]),
        ({"start": 2500.0}, [START, *MATERIAL]),
        ({"order": 2}, ["elements", START, *MATERIAL, "regularisers"]),
        ({"labelled": True}, [START, *MATERIAL, "regularisers"]),
    ],
    ids=["misfit", "prior", "noise", "start", "order", "labelled"],
)
def test_other_choices(changes, words):
    found = differing_parts(problem_fingerprint(problem(data(), **changes)), problem_fingerprint(problem(data())))
    assert set(words) <= set(found)
    if len(words) == 1:
        assert found == words


def test_other_labels():
    """Other labels change neither the number of unknowns nor the initial guess."""
    moved = replace(data(), labels=(data().points[:, 0] > 0.024).astype(int))
    one, other = (problem_fingerprint(problem(each, labelled=True)) for each in (data(), moved))
    assert differing_parts(one, other) == MATERIAL


def test_another_driven_boundary():
    """One driven side less; its initial guess is not part of the problem."""
    flags = data().dirichlet & (data().points[:, 0] > 1e-9)
    assert differing_parts(
        problem_fingerprint(problem(replace(data(), dirichlet=flags))), problem_fingerprint(problem(data()))
    ) == ["driven boundary"]


def test_another_guess_of_unknown_displacements_is_no_other_problem():
    """Other prescribed displacements make another problem."""
    free = [problem(data()) for _ in range(2)]
    free[1].unknowns.start[free[1].unknowns.blocks[BOUNDARY]] *= 1.01
    assert not differing_parts(*map(problem_fingerprint, free))
    held = [problem(data()) for _ in range(2)]
    for factor, each in zip((1.0, 1.01), held, strict=True):
        theta = each.unknowns.theta(each.unknowns.start)
        theta[each.model.blocks[BOUNDARY]] *= factor
        fields = {name: unknown for name, unknown in each.unknowns.unknowns.items() if name != BOUNDARY}
        each.unknowns = ParameterFields(theta, each.model.blocks, fields)
    assert differing_parts(*map(problem_fingerprint, held)) == [START]


def test_fields_keep_their_values():
    reduced = problem(data())
    for field in reduced.model.fields.values():
        field.Set(ngs.x)
    before = reduced.model.theta
    problem_fingerprint(reduced)
    assert np.array_equal(reduced.model.theta, before)


def test_what_is_no_identity_differs_in_all():
    assert differing_parts("a hash of old", {"points": "a", "elements": "b"}) == ["points", "elements"]
