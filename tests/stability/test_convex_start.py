"""Starts from measured waves of nearly incompressible tissue. Naive: the pressure is K ∇·u. Ours: it is one more unknown.

Moduli that fulfil the equation of motion of measured waves best are found by linear least squares. With p = K ∇·u of the
measured u, the noise of ∇·u counts K/G times as much as that of the strains which tell of G. Young's modulus of a spot on a
square, ν = .4995 (K = 1000 G): with the true K and with whatever weight is best the naive start comes no nearer to the truth
than a uniform field, which is 8.8 % off, with 1 % noise and with .1 %; smoothing the waves before changes nothing. Ours is 1.1
and 1.3 % off. Without noise, in the data's own elements, the naive one is exact; where K = 5 G it is 4 % off.
"""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
import scipy.sparse.linalg

from ngbrain.inverse.data.smoothing import fit_splines
from ngbrain.inverse.optimise.gauss_newton import GaussNewton
from ngbrain.inverse.phantoms.benchmark import Phantom

WEIGHTS = 10.0 ** np.arange(-6, 9)
"""Of smoothness, over the mean of the normal equations' diagonal."""


def spot(poisson, noise):
    return replace(Phantom.from_name("NE-G", 25), poisson=poisson).simulate_measurements(noise)


def naive(measured, u):
    """The smallest error, over all weights, of moduli that fulfil best the equation of motion of u (n, 2) with p = K ∇·u."""
    inversion = measured.inversion(start=measured.truth)
    model, n = inversion.model, u.size
    state = model.linearise(model.theta, np.zeros_like(inversion.waves))
    matrix, waves = state.factors.matrix(0), np.zeros_like(inversion.waves)
    waves[0, :n] = u.T.ravel()
    waves[0, n:] = -(matrix[n:, :n] @ waves[0, :n]) / matrix[n:, n:].diagonal()  # with the true K
    state = model.linearise(model.theta, waves)
    inner = np.flatnonzero(~model.body.fixed[:n])
    by_modulus = state.sensitivity.matrices[0][inner]
    rest = (matrix @ waves[0])[inner] - by_modulus @ measured.truth["youngs"]
    normal, right = (by_modulus.conj().T @ by_modulus).real, -(by_modulus.conj().T @ rest).real
    uniform = np.full(len(right), measured.phantom.start["youngs"])
    smooth = inversion.reduced.regularisers["youngs"].matrix(uniform)
    errors = []
    for weight in WEIGHTS * normal.diagonal().mean():
        R = weight * smooth
        found = scipy.sparse.linalg.spsolve(sp.csc_array(normal + R), right + R @ uniform)
        errors.append(measured.errors({"youngs": found})["youngs"])
    return min(errors)


def ours(measured):
    """After the first, linear, round."""
    inversion = measured.inversion()
    found = GaussNewton(inversion.reduced).from_waves(inversion.start, inversion.waves, max_iterations=1)
    return inversion.errors(found.x)["youngs"]


def test_naive_is_right_without_noise_and_of_compressible_tissue():
    exact, compressible = spot(0.4995, 0.0), spot(0.41, 0.01)
    assert naive(exact, exact.displacement[0]) < 1e-5
    assert naive(compressible, compressible.displacement[0]) < 0.05


@pytest.mark.parametrize("noise", [0.01, 0.001])
def test_naive_pressures_drown_in_noise(noise):
    measured = spot(0.4995, noise)
    truth = measured.truth["youngs"]
    uniform = measured.errors({"youngs": np.full(len(truth), truth.mean())})["youngs"]
    for u in (measured.displacement[0], fit_splines(measured.data()).values()[0]):
        assert naive(measured, u) > uniform > 0.087


@pytest.mark.parametrize("noise", [0.01, 0.001])
def test_free_pressures_do_not(noise):
    assert ours(spot(0.4995, noise)) < 0.015
