"""The memory of relaxing tissue: H_k and S̄_k of every branch at every quadrature point."""

from __future__ import annotations

import ngsolve as ngs
import numpy as np
from ngsolve import CoefficientFunction
from ngsolve.comp import IntegrationRuleSpace

from ngbrain.materials import Viscous, step_factors

REST = 1e30
"""Relaxation time (s) that stands for 'does not relax', where a region has fewer branches than another."""


class History:
    """H_k, S̄_k per branch, C̄, and what a time step's energy needs of them: β_k and G = Σ (e_k H_k - β_k S̄_k); C̄ before it.

    mesh       NGSolve mesh
    laws       region pattern → `Viscous`
    order      order of the quadrature-point space (order 1: the 4-point rule on tetrahedra)
    """

    def __init__(self, mesh: ngs.Mesh, laws: dict[str, Viscous], order: int) -> None:
        self.mesh, self.laws = mesh, laws
        self.space = IntegrationRuleSpace(mesh, order=order)
        self.rules = self.space.GetIntegrationRules()
        tensors = ngs.MatrixValued(self.space, 3)
        self.pull = ngs.GridFunction(tensors)
        self.shape = ngs.GridFunction(tensors)
        self.strain = np.outer(np.eye(3).ravel(), np.ones(self.space.ndof))
        self.per_dt = ngs.Parameter(0.0)
        self._new = ngs.GridFunction(tensors)
        self.n_branches = max((len(law.branches) for law in laws.values()), default=0)
        points = self.space.ndof
        self.stress = np.zeros((self.n_branches, 9, points))
        self.overstress = np.zeros((self.n_branches, 9, points))
        self.shares = [ngs.GridFunction(self.space) for _ in range(self.n_branches)]
        self.tau = np.full((self.n_branches, points), REST)
        for k in range(self.n_branches):
            field = ngs.GridFunction(self.space)
            times = {pattern: law.branches[k].tau for pattern, law in laws.items() if len(law.branches) > k}
            field.Interpolate(mesh.MaterialCF(times, default=REST))
            self.tau[k] = field.vec.FV().NumPy()
        self._stress_cf: list[CoefficientFunction] = []
        self._shape_cf: CoefficientFunction = ngs.Id(3)
        self.dt = 0.0

    def follow(self, C: CoefficientFunction) -> None:
        """Set the isochoric C̄ (of the current state) that `finish` evaluates the branch stresses at."""
        self._stress_cf, self._shape_cf = [], C.Compile()
        zero = ngs.CF((0,) * 9, dims=(3, 3))
        for k in range(self.n_branches):
            by_region = {
                pattern: law.branches[k].stress(C).Compile()
                for pattern, law in self.laws.items()
                if len(law.branches) > k
            }
            self._stress_cf.append(self.mesh.MaterialCF(by_region, default=zero))

    def begin(self, dt: float) -> None:
        """Set β_k, the pull G and the C̄ before a step of `dt` seconds."""
        self.dt = dt
        self.per_dt.Set(1 / dt)
        pull = np.zeros((9, self.space.ndof))
        for k in range(self.n_branches):
            e, beta = step_factors(dt, self.tau[k])
            self.shares[k].vec.FV().NumPy()[:] = beta
            pull += e * self.overstress[k] - beta * self.stress[k]
        self.pull.vec.FV().NumPy()[:] = pull.ravel()
        self.shape.vec.FV().NumPy()[:] = self.strain.ravel()

    def finish(self) -> None:
        """Move the history to the end of the step begun, at the state that now stands.

        What the energy sees stays as it was in the step until the next one begins, so that its forces can still be read.
        """
        self.strain = self._at_points(self._shape_cf)
        for k in range(self.n_branches):
            e, beta = step_factors(self.dt, self.tau[k])
            new = self._at_points(self._stress_cf[k])
            self.overstress[k] = e * self.overstress[k] + beta * (new - self.stress[k])
            self.stress[k] = new

    def _at_points(self, field: CoefficientFunction) -> np.ndarray:
        self._new.Interpolate(field)
        return self._new.vec.FV().NumPy().reshape(9, -1).copy()
