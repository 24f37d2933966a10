"""Kinematics of the homogeneous tests: isochoric deformations with prescribed and free entries."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import ngsolve as ngs
import numpy as np
from ngsolve import CoefficientFunction

from ngbrain.errors import InputError, nearest


@dataclass(frozen=True)
class Mode:
    """Kinematics of a test: F(x) with det F = 1 for any x, so that the pressure drops out.

    Parameters
    ----------
    name : str
        Name of the test.
    rest : float
        Stretch of the undeformed body: 1, or 0 for a shear.
    given : int
        Number of leading entries of x that the test prescribes; the others minimise the energy.
    deformation : callable
        x (CoefficientFunction) → F, 3×3.
    isotropic : callable
        Stretches (n,) → x (entries, n) of an isotropic body.
    """

    name: str
    rest: float
    given: int
    deformation: Callable[[CoefficientFunction], CoefficientFunction]
    isotropic: Callable[[np.ndarray], np.ndarray]

    def check_stretches(self, stretches: object) -> np.ndarray:
        """The stretches as an array; raises `InputError` unless they are finite and, where they are ratios, positive."""
        try:
            values = np.asarray(stretches, dtype=float)
        except (TypeError, ValueError):
            raise InputError("stretches", repr(stretches), "numbers") from None
        wanted = "finite numbers" + (" > 0" if self.rest else "")
        wrong = ~np.isfinite(values) | (values <= 0 if self.rest else False)
        if values.size == 0 or np.any(wrong):
            raise InputError("stretches", float(values[wrong].flat[0]) if values.size else "empty", wanted)
        return values


def _upper(*entries: object) -> CoefficientFunction:
    a, b, c, d, e, f = entries
    return ngs.CF((a, b, c, 0, d, e, 0, 0, f), dims=(3, 3))


def _uniaxial(x: CoefficientFunction) -> CoefficientFunction:
    side = ngs.exp(x[4])
    return _upper(x[0], x[1], x[2], side, x[3], 1 / (x[0] * side))


def _zeros(stretches: np.ndarray, count: int) -> list[np.ndarray]:
    return [np.zeros_like(stretches)] * count


MODES = {
    mode.name: mode
    for mode in (
        Mode("uniaxial", 1.0, 1, _uniaxial, lambda s: np.array([s, *_zeros(s, 3), -np.log(s) / 2])),
        Mode(
            "equibiaxial",
            1.0,
            2,
            lambda x: _upper(x[0], 0, x[2], x[1], x[3], 1 / (x[0] * x[1])),
            lambda s: np.array([s, s, *_zeros(s, 2)]),
        ),
        Mode(
            "planar",
            1.0,
            1,
            lambda x: _upper(x[0], 0, x[1], 1, x[2], 1 / x[0]),
            lambda s: np.array([s, *_zeros(s, 2)]),
        ),
        Mode("shear", 0.0, 1, lambda x: _upper(1, x[0], 0, 1, 0, 1), lambda s: np.array([s])),
    )
}


def find_mode(name: str) -> Mode:
    """The test of a name; raises `InputError` for an unknown name."""
    if name not in MODES:
        raise InputError("mode", repr(name), nearest(str(name), MODES))
    return MODES[name]
