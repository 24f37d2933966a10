"""Internal variables of viscoelastic tissue at quadrature points: H_k and S̄_k of hereditary branches, C_v of Maxwell branches."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import ngsolve as ngs
import numpy as np
from ngsolve import CoefficientFunction
from ngsolve.comp import IntegrationRuleSpace

from ngbrain.materials import MaxwellTerm, MaxwellVariables, Viscous, step_factors
from ngbrain.materials.base import Value
from ngbrain.materials.points import Points
from ngbrain.tensors import from_voigt, to_voigt

REST = 1e30
"""Relaxation time (s) in place of none, where a region has fewer branches than another."""


class History:
    """Internal variables of viscoelastic tissue at the quadrature points, and their contribution to a step's energy.

    H_k and S̄_k of hereditary branches, `MaxwellTerm` of Maxwell ones, and C̄. Tensors are stored by their `to_voigt` entries:
    `stress` S̄_k and `overstress` H_k (branches, 6, points) in Pa, `strain` C̄.

    Parameters
    ----------
    mesh : ngsolve.Mesh
    regions : dict
        Region pattern → `Viscous`.
    order : int
        Order of the quadrature-point space (order 1: the 4-point rule on tetrahedra).
    """

    def __init__(self, mesh: ngs.Mesh, regions: dict[str, Viscous], order: int) -> None:
        self.mesh, self.regions = mesh, regions
        self.space = IntegrationRuleSpace(mesh, order=order)
        self.rules = self.space.GetIntegrationRules()
        tensors = ngs.VectorValued(self.space, 6)
        self.pull = ngs.GridFunction(tensors)
        self.points = Points(self.space, mesh.MapToAllElements(dict(self.rules), ngs.VOL))
        self.n_branches = max((len(region.hereditary_branches) for region in regions.values()), default=0)
        self.shares = [ngs.GridFunction(self.space) for _ in range(self.n_branches)]
        most = max((len(region.maxwell_branches) for region in regions.values()), default=0)
        self.maxwell = MaxwellTerm(self.points, [self._maxwell_branch(k) for k in range(most)])
        self.reset()
        self._stress_cf: list[CoefficientFunction] = []
        self._shape_cf: CoefficientFunction = to_voigt(ngs.Id(3))
        self.dt = 0.0

    def reset(self) -> None:
        """Reset to rest, with the current relaxation times and viscosities."""
        points = self.space.ndof
        self.strain = np.outer([1.0, 1.0, 1.0, 0.0, 0.0, 0.0], np.ones(points))
        self.stress = np.zeros((self.n_branches, 6, points))
        self.overstress = np.zeros((self.n_branches, 6, points))
        self._tau = np.full((self.n_branches, points), REST)
        for k in range(self.n_branches):
            times = {
                name: r.hereditary_branches[k].tau for name, r in self.regions.items() if len(r.hereditary_branches) > k
            }
            self._tau[k] = self._values(times, REST)
        for k, branch in enumerate(self.maxwell.branches):
            branch.reset(self._viscosity(k))

    def _viscosity(self, k: int) -> np.ndarray:
        etas = {name: r.maxwell_branches[k].eta for name, r in self.regions.items() if len(r.maxwell_branches) > k}
        return self._values(etas, 0.0)

    def _maxwell_branch(self, k: int) -> MaxwellVariables:
        """The k-th Maxwell branch of all regions that have one; elsewhere with zero viscosity, so that it carries no stress."""
        branches = {name: r.maxwell_branches[k] for name, r in self.regions.items() if len(r.maxwell_branches) > k}
        absent = ngs.CF((0.0, 0.0, 0.0, 1.0, 0.0, 1.0))

        def slopes(strain: CoefficientFunction) -> CoefficientFunction:
            parts = {name: branch.slopes(strain) for name, branch in branches.items()}
            return self.mesh.MaterialCF(parts, default=absent)

        return MaxwellVariables(self.points, slopes, self._viscosity(k))

    def _values(self, by_region: dict[str, Value], default: float) -> np.ndarray:
        field = ngs.GridFunction(self.space)
        field.Interpolate(self.mesh.MaterialCF(by_region, default=default))
        return field.vec.FV().NumPy().copy()

    def energy(self, region: Viscous, C: CoefficientFunction) -> CoefficientFunction:
        """Incremental energy ½ Σ (e_k H_k - β_k S̄_k) : C̄ + Maxwell branches, up to a constant; the sum over k is stored as
        one tensor field, `pull`.

        Parameters
        ----------
        region : Viscous
        C : CoefficientFunction
            C̄.

        Returns
        -------
        CoefficientFunction
        """
        return self._history_energy(region, C) + (self.maxwell.energy(C) if region.maxwell_branches else 0.0)

    def work(self, region: Viscous, C: CoefficientFunction) -> CoefficientFunction:
        """Expression with the derivative of `energy` at the current state, for forces only.

        Parameters
        ----------
        region : Viscous
        C : CoefficientFunction
            C̄.

        Returns
        -------
        CoefficientFunction
        """
        return self._history_energy(region, C) + (self.maxwell.work(C) if region.maxwell_branches else 0.0)

    def _history_energy(self, region: Viscous, C: CoefficientFunction) -> CoefficientFunction:
        return 0.5 * ngs.InnerProduct(from_voigt(self.pull), C) if region.hereditary_branches else ngs.CF(0.0)

    def follow(self, C: CoefficientFunction) -> None:
        """Set the isochoric C̄ (of the current state) that `relax` and `finish` evaluate the branches at."""
        self._stress_cf, self._shape_cf = [], to_voigt(C).Compile()
        for k in range(self.n_branches):
            by_region = {
                name: to_voigt(r.hereditary_branches[k].stress(C)).Compile()
                for name, r in self.regions.items()
                if len(r.hereditary_branches) > k
            }
            self._stress_cf.append(self.mesh.MaterialCF(by_region, default=ngs.CF((0.0,) * 6)))

    def begin(self, dt: float) -> None:
        """Set β_k, the history term and the branches for a step of `dt` seconds."""
        self.dt = dt
        pull = np.zeros_like(self.strain)
        for k in range(self.n_branches):
            e, beta = step_factors(dt, self._tau[k])
            self.shares[k].vec.FV().NumPy()[:] = beta
            pull += e * self.overstress[k] - beta * self.stress[k]
        self.pull.vec.FV().NumPy()[:] = pull.ravel()
        self.maxwell.begin(dt, self.strain)

    def relax(self) -> None:
        """Solve for the Maxwell branches at the current state."""
        self.maxwell.relax(self.shapes())

    def finish(self) -> None:
        """Update the internal variables at the end of the step, at the current state.

        The coefficients of the energy stay those of the step until the next one begins, so that forces can still be read.
        """
        self.strain = self.shapes()
        self.maxwell.finish(self.strain)
        before, self.stress, self.overstress = self.stress, np.empty_like(self.stress), self.overstress.copy()
        for k in range(self.n_branches):
            e, beta = step_factors(self.dt, self._tau[k])
            self.stress[k] = self.points(self._stress_cf[k])
            self.overstress[k] = e * self.overstress[k] + beta * (self.stress[k] - before[k])

    def shapes(self) -> np.ndarray:
        """C̄ of the current state (6, points)."""
        return self.points(self._shape_cf)

    def here(self) -> tuple[np.ndarray, list[np.ndarray]]:
        """C̄ and each S̄_k at the current state."""
        return self.shapes(), [self.points(stress) for stress in self._stress_cf]

    def half_step_error(self, middle: tuple[np.ndarray, list[np.ndarray]]) -> tuple[float, float]:
        """Rms over quadrature points (Pa) of the change of overstress by two half steps through `middle`, and of the overstress.

        `middle` is as from `here`. To be called before `finish`; nothing is changed.
        """
        end, half = self.here(), 0.5 * self.dt
        change, size = np.zeros_like(self.strain), np.zeros_like(self.strain)
        for k in range(self.n_branches):
            first, last = middle[1][k] - self.stress[k], end[1][k] - middle[1][k]
            e, beta = step_factors(self.dt, self._tau[k])
            once = e * self.overstress[k] + beta * (first + last)
            e, beta = step_factors(half, self._tau[k])
            twice = e * (e * self.overstress[k] + beta * first) + beta * last
            change, size = change + twice - once, size + twice
        for branch in self.maxwell.branches:
            twice = branch.half_step_stress(half, middle[0], end[0])
            change, size = change + twice - branch.stress, size + twice
        return float(np.sqrt(np.mean(change**2))), float(np.sqrt(np.mean(size**2)))

    # Restart.

    @property
    def internal(self) -> Mapping[str, Any]:
        """Everything that determines later steps."""
        inner = [branch.G for branch in self.maxwell.branches]
        return {"stress": self.stress, "overstress": self.overstress, "strain": self.strain, "inner": inner}

    @internal.setter
    def internal(self, saved: Mapping[str, Any]) -> None:
        self.stress, self.overstress, self.strain = saved["stress"], saved["overstress"], saved["strain"]
        for branch, G in zip(self.maxwell.branches, saved["inner"], strict=True):
            branch.G = G

    @property
    def frozen(self) -> Mapping[str, Any]:
        """Coefficients of the energy of the current step, after `relax`."""
        pull = self.pull.vec.FV().NumPy().copy()
        return {"dt": self.dt, "pull": pull, "flows": self.maxwell.frozen}

    @frozen.setter
    def frozen(self, saved: Mapping[str, Any]) -> None:
        self.begin(saved["dt"])
        self.pull.vec.FV().NumPy()[:] = saved["pull"]
        self.maxwell.frozen = saved["flows"]
