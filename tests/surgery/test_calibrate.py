"""Calibration from a retraction: a known truth is recovered, unidentifiable factors are reported, bad input is refused."""

import math
from dataclasses import replace

import numpy as np
import pytest

from ngbrain.adjoint import check
from ngbrain.errors import InputError
from ngbrain.materials import Ogden, constants
from ngbrain.materials.families import stiffen
from ngbrain.scene import Protocol, Scene
from ngbrain.surgery.calibrate import CalibrationModel, calibrate
from ngbrain.surgery.model import RetractionModel
from ngbrain.surgery.observations import Observations

TIMES = np.array([2.0, 6.0])
TRUTH = {"cortex": 1.5, "white": 0.7}


def operation(**blade):
    scene = Scene.shipped("idealised_fast")
    return replace(
        scene,
        protocols=(Protocol(kind="continuous"),),
        mesh=replace(scene.mesh, wall=0.008, craniotomy=0.02, largest=0.05),
        tools=(replace(scene.tool, **blade, travel=2e-3),),
        time=replace(scene.time, ramp=2.0, end=6.0, step_tolerance=0.1),
    )


@pytest.fixture(scope="module")
def model():
    return RetractionModel.from_scene(operation())


@pytest.fixture(scope="module")
def landmarks(model):
    around = np.array([[x, y, z] for x in (-12, 14) for y in (-8, 9) for z in (-6, 7)]) / 1000
    return model.cleft.target + around


@pytest.fixture(scope="module")
def retracted(model, landmarks):
    return CalibrationModel(model, landmarks, TIMES, list(TRUTH))


def seen(retracted, landmarks, noise, force=True):
    data = retracted.run.evaluate(np.array(list(TRUTH.values()))).data
    moved, pushed = data[:, :-1].reshape(2, -1, 3), data[:, -1]
    sigma = noise * float(np.sqrt(np.mean(moved**2))), noise * float(np.abs(pushed).max())
    random = np.random.default_rng(2)
    moved = moved + sigma[0] * random.normal(size=moved.shape)
    pushed = pushed + sigma[1] * random.normal(size=2) if force else np.full(2, np.nan)
    return Observations(TIMES, landmarks, moved, pushed, sigma)


def test_constants_times_a_factor_relax_as_quickly():
    cortex = constants("griffiths2024:cortex").law()
    twice = stiffen(cortex, 2.0)
    assert twice.equilibrium == Ogden(2 * cortex.equilibrium.mu, cortex.equilibrium.alpha)
    for one, other in zip(cortex.branches, twice.branches, strict=True):
        assert other.law == Ogden(2 * one.law.mu, one.law.alpha) and other.tau == pytest.approx(one.tau)


@pytest.mark.slow
def test_the_force_and_the_landmarks_have_their_derivatives(retracted):
    at, along = np.array([1.2, 0.9]), np.array([0.5, -0.7])
    scale = np.abs(retracted.run.evaluate(at).data).max(axis=0)
    there = retracted.run.evaluate(at)
    change = there.jvp(along) / scale
    rates = check.taylor(
        lambda x: retracted.run.evaluate(x).data / scale, lambda dx: change, at, along, steps=2, first=0.1
    )
    assert np.all(np.abs(rates - 2) < 0.15), rates


@pytest.mark.slow
def test_a_known_truth_comes_back(model, retracted, landmarks):
    got = calibrate(model, seen(retracted, landmarks, 0.01), list(TRUTH), finer=False)
    print(got.factors, got.level)
    for name, factor in TRUTH.items():
        band = got.factors[name]
        assert band.value == pytest.approx(factor, rel=0.03) and band.low < factor < band.high
    assert 0.4 < got.level.ratio < 2 and got.converged
    stiff = {tissue.region: tissue.initial_modulus for tissue in got.scene.tissues}
    before = {tissue.region: tissue.initial_modulus for tissue in model.scene.tissues}
    assert stiff["white"] / before["white"] == pytest.approx(got.factors["white"].value)
    assert stiff["ventricle.*"] == before["ventricle.*"]
    for old, new in zip(model.scene.tissues, got.scene.tissues, strict=True):
        assert new.bulk == pytest.approx(old.bulk)


@pytest.mark.slow
def test_finer_elements_move_the_factors_and_widen_the_intervals(model, landmarks):
    """Data of elements half as large. The direction of the step is tested where discretisation errors have an order
    (`inverse/test_defect.py`); in a head so coarse, .7 times as large means 1.1 times as many elements.
    """
    scene = model.scene
    sizes = {name: getattr(scene.mesh, name) / 2 for name in ("wall", "craniotomy", "largest")}
    fine = RetractionModel.from_scene(replace(scene, mesh=replace(scene.mesh, **sizes)), model.head)
    data = seen(CalibrationModel(fine, landmarks, TIMES, list(TRUTH)), landmarks, 0.01)
    naive, got = (calibrate(model, data, list(TRUTH), finer=finer) for finer in (False, True))
    assert naive.moved is None
    for name, factor in TRUTH.items():
        print(name, factor, naive.factors[name], got.factors[name], got.moved[name])
        assert got.factors[name].low < factor < got.factors[name].high and got.moved[name] != 1
        assert got.factors[name].value == pytest.approx(naive.factors[name].value * got.moved[name])
        wide = [math.log(each.factors[name].high / each.factors[name].low) for each in (naive, got)]
        assert wide[1] > wide[0]


@pytest.mark.slow
def test_landmarks_alone_tell_less(model, retracted, landmarks):
    """The scale follows from the ventricles, which are not calibrated, and from the bulk moduli."""
    got = calibrate(model, seen(retracted, landmarks, 0.01, force=False), list(TRUTH), finer=False)
    print(got.factors)
    for name, factor in TRUTH.items():
        band = got.factors[name]
        assert band.low < factor < band.high and 1.1 < band.high / band.low < 1.2  # with the force 1.04 and 1.05


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"displacements": np.zeros((1, 8, 3))}, "as given by times and landmarks"),
        ({"force": np.zeros(3)}, "as given by times and landmarks"),
        ({"sigma": (1e-4, 0.0)}, "positive standard deviations"),
        ({"displacements": np.full((2, 8, 3), np.nan), "force": np.full(2, np.nan)}, "displacements or forces"),
    ],
)
def test_measurements_without_sense_are_refused(wrong, said):
    right = {"displacements": np.zeros((2, 8, 3)), "force": np.zeros(2), "sigma": (1e-4, 0.1)}
    with pytest.raises(InputError, match=said):
        Observations(TIMES, np.zeros((8, 3)), **{**right, **wrong})


def test_operations_that_cannot_be_differentiated_are_refused(model, landmarks):
    with pytest.raises(InputError, match="1 outside of the mesh"):
        CalibrationModel(model, np.vstack([landmarks, [[1.0, 0, 0]]]), TIMES)
    with pytest.raises(InputError, match="2 to 60 s; wanted: after 0 and up to 6 s, when continuous ends"):
        CalibrationModel(model, landmarks, [2.0, 60.0])
    with pytest.raises(InputError, match="did you mean 'cortex'"):
        CalibrationModel(model, landmarks, TIMES, ["cortx"])
    rough = replace(model, scene=replace(model.scene, tools=(replace(model.scene.tool, friction=0.2),)))
    with pytest.raises(InputError, match="without friction"):
        CalibrationModel(rough, landmarks, TIMES)
    data = Observations(TIMES, landmarks, np.zeros((2, 8, 3)), np.zeros(2), (1e-4, 0.1))
    with pytest.raises(InputError, match="above 1"):
        calibrate(model, data, spread=1.0)
    with pytest.raises(InputError, match="factors above 0"):
        calibrate(model, data, start={"white": 0.0})


def test_a_tissue_with_a_map_of_moduli_is_not_looked_for(model, landmarks):
    first, *others = model.scene.tissues
    mapped = replace(model.scene, tissues=(replace(first, shear_modulus_map="mu.nii"), *others))
    with pytest.raises(InputError, match=f"tissues is {first.region}, which has a shear_modulus_map"):
        CalibrationModel(replace(model, scene=mapped), landmarks, TIMES, [first.region])
