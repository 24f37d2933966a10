"""Internal nodal forces from the energy: stresses derived symbolically, evaluated at quadrature points, then integrated."""

from __future__ import annotations

from collections.abc import Callable

import ngsolve as ngs
import numpy as np
from ngsolve import CoefficientFunction
from ngsolve.comp import IntegrationRuleSpace

from ngbrain.forward.common.kinematics import SolidKinematics
from ngbrain.forward.common.unknowns import Layout
from ngbrain.materials.base import Deformation
from ngbrain.materials.points import Points
from ngbrain.tensors import isochoric, isochoric_factor, right_cauchy_green

Density = Callable[[Deformation, CoefficientFunction | None], CoefficientFunction]
"""Energy density (Pa) of a state and the pressure p, if there is one."""


def stresses(
    density: Density, F: Callable[[], CoefficientFunction], p: CoefficientFunction | None
) -> CoefficientFunction:
    """Symbolic stresses ∂W/∂F (Pa), nine entries by rows, and ∂W/∂p.

    The order of differentiation determines the cost: NGSolve stores the derivative of a tensor with respect to a tensor as 81
    entries. So only that of C with respect to F is taken, in closed form: ∂W/∂F = 2F sym ∂W/∂C (a law of single entries of C
    leaves it unsymmetric). Of C̄ = s(C) C only s is differentiated: of s ∂W/∂C̄ : C, a derivative with respect to C would have
    81 entries. C̄, C, J and F are separate variables: W is differentiated with respect to one at a time.

    Parameters
    ----------
    density : callable
        Energy density (Pa) of a `Deformation` and p.
    F : callable
        Gives the deformation gradient, a new expression at each call: a variable can be used in one expression only.
    p : CoefficientFunction, optional
        Pressure (Pa).

    Returns
    -------
    CoefficientFunction (9,) or (10,)
    """
    shape, C = isochoric(right_cauchy_green(F())).MakeVariable(), right_cauchy_green(F()).MakeVariable()
    moving, J, pressure = F().MakeVariable(), ngs.Det(F()).MakeVariable(), p if p is None else p.MakeVariable()
    whole, gradient = right_cauchy_green(F()).MakeVariable(), F().MakeVariable()
    energy = density(Deformation(shape, whole, J, gradient), pressure)
    S, scale = energy.Diff(shape), isochoric_factor(C)
    by_C = scale * S + ngs.InnerProduct(S, C) * scale.Diff(C) + energy.Diff(whole)
    P = F() * (by_C + by_C.trans) + energy.Diff(J) * ngs.Det(moving).Diff(moving) + energy.Diff(gradient)
    return (P.Reshape((9,)) if pressure is None else ngs.CF((P.Reshape((9,)), energy.Diff(pressure)))).Compile()


class InternalForces:
    """Internal nodal forces ∫ ∂W/∂F : ∇v + ∂W/∂p q, for every test function.

    NGSolve's own form would evaluate the energy once for each of the ten entries; here all are evaluated together.

    Parameters
    ----------
    layout : Layout
    gfu : GridFunction
        Current unknowns.
    densities : dict
        Region pattern → energy density.
    space : IntegrationRuleSpace
        Quadrature points, with their rules.
    kinematics : SolidKinematics
    """

    def __init__(
        self,
        layout: Layout,
        gfu: ngs.GridFunction,
        densities: dict[str, Density],
        space: IntegrationRuleSpace,
        kinematics: SolidKinematics,
    ) -> None:
        self.mesh = gfu.space.mesh
        now, test = layout.fields(gfu), layout.fields(gfu.space.TestFunction())
        size = 9 if now.p is None else 10
        self._stress = ngs.GridFunction(ngs.VectorValued(space, size))
        self._values = np.zeros((size, space.ndof))

        def F() -> CoefficientFunction:
            return kinematics.gradient(now.u, ngs.Grad(now.u))

        self._derived = self.mesh.MaterialCF(
            {pattern: stresses(density, F, now.p) for pattern, density in densities.items()}
        )
        self._points = Points(space, self.mesh.MapToAllElements(dict(space.GetIntegrationRules()), ngs.VOL))
        self._moving = np.ones(space.ndof, bool)
        P = ngs.CF(tuple(self._stress[i] for i in range(9)), dims=(3, 3))
        work = ngs.InnerProduct(P, kinematics.change(test.u, ngs.Grad(test.u)))
        if now.p is not None:
            work = work + self._stress[9] * test.p
        self._form = ngs.LinearForm(gfu.space)
        self._form += kinematics.weight() * work * ngs.dx(intrules=space.GetIntegrationRules())

    def leave_out(self, points: np.ndarray) -> None:
        """Exclude some points, by number, from all further evaluations."""
        self._moving = np.ones(self._moving.size, bool)
        self._moving[points] = False
        self._values[:] = 0

    @property
    def stress(self) -> np.ndarray:
        """∂W/∂F (Pa), (n, 3, 3) at the points of `space`, of the last call."""
        return self._values[:9].T.reshape(-1, 3, 3)

    def __call__(self) -> np.ndarray:
        """Nodal forces at the current state, one number per unknown."""
        self._values[:, self._moving] = self._points(self._derived, self._moving)
        self._stress.vec.FV().NumPy()[:] = self._values.ravel()
        self._form.Assemble()
        return self._form.vec.FV().NumPy().copy()
