"""Fibres in a dilatation. Naive: split off its change of volume and they bear nothing. Ours: the closed form."""

import ngsolve as ngs
import numpy as np
import pytest
from states import stress

from ngbrain.materials import HolzapfelGasserOgden

MU, K1, K2, DILATATION = 500.0, 2e3, 5.0, 1.1
FIBRE = np.array([1.0, 2.0, 2.0]) / 3


class Split:
    """The same law of C̄ alone."""

    def energy(self, C):
        beyond = C * ngs.CF(tuple(FIBRE)) * ngs.CF(tuple(FIBRE)) - 1
        fibres = K1 / (2 * K2) * (ngs.exp(K2 * ngs.IfPos(beyond, beyond * beyond, 0.0)) - 1)
        return MU / 2 * (ngs.Trace(C) - 3) + fibres


def test_naive_fibres_bear_nothing_when_swollen():
    assert np.abs(stress(Split(), DILATATION * np.eye(3))).max() < 1e-9 * MU


def test_ours_are_stretched_like_any_line():
    beyond = DILATATION**2 - 1
    wanted = 2 * K1 * DILATATION * beyond * np.exp(K2 * beyond**2) * np.outer(FIBRE, FIBRE)
    assert np.trace(wanted) == pytest.approx(1152, abs=1)  # Pa, more than twice the matrix' modulus
    law = HolzapfelGasserOgden(MU, K1, K2, 0.0, tuple(FIBRE))
    assert stress(law, DILATATION * np.eye(3))[0] == pytest.approx(wanted, rel=1e-10)


def test_both_agree_without_change_of_volume(rng):
    F = np.eye(3) + 0.1 * rng.normal(size=(20, 3, 3))
    F /= np.cbrt(np.linalg.det(F))[:, None, None]
    law = HolzapfelGasserOgden(MU, K1, K2, 0.0, tuple(FIBRE))

    def shear_parts(P):  # Cauchy stress but for its pressure, of states without change of volume, and of no other kind
        sigma = P @ F.transpose(0, 2, 1)
        return sigma - np.trace(sigma, axis1=1, axis2=2)[:, None, None] / 3 * np.eye(3)

    assert shear_parts(stress(law, F)) == pytest.approx(shear_parts(stress(Split(), F)), rel=1e-10, abs=1e-9)
