"""Tissue term of a problem: energy, internal variables at quadrature points, nodal forces and stress."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import ngsolve as ngs
import numpy as np
from ngsolve import CoefficientFunction

from ngbrain.errors import Breakdown
from ngbrain.forward.common.elements import ElementPair
from ngbrain.forward.common.kinematics import SolidKinematics
from ngbrain.forward.common.material import Material
from ngbrain.forward.common.state import Term
from ngbrain.forward.common.unknowns import Layout
from ngbrain.forward.solid.internal_forces import Density, InternalForces
from ngbrain.forward.solid.internal_variables import History
from ngbrain.materials import Viscous
from ngbrain.materials.base import Deformation, Value
from ngbrain.materials.points import EVERYWHERE
from ngbrain.result import Status
from ngbrain.tensors import isochoric, right_cauchy_green

Array = np.ndarray
HistoryEnergy = Callable[[Viscous, CoefficientFunction], CoefficientFunction]
"""Energy of the internal variables as a function of C̄: `History.energy`, or `History.work` for forces alone."""


class TissueTerm(Term):
    """Tissue term of a problem: energy Σ_regions W(C̄; history) + U(J), or + p(J - 1) - p²/2K.

    Viscoelastic tissue has a `History`, at whose quadrature points the energy and the stresses are evaluated. An elastic body
    under loads alone has a quadrature of order 2k (+ `bonus`), and NGSolve differentiates the energy.

    Parameters
    ----------
    layout : Layout
    gfu : GridFunction
        Current unknowns.
    kinematics : SolidKinematics
    materials : dict
        Region pattern → `Material`.
    element : ElementPair
    through_time : bool
        Whether there is a history.
    bonus : int
        Additional orders of quadrature.
    factor : float or Parameter
        Load factor, to which swelling is proportional.

    Attributes
    ----------
    rules : element shape → quadrature
    history : `History` or None
    points : all quadrature points
    """

    def __init__(
        self,
        layout: Layout,
        gfu: ngs.GridFunction,
        kinematics: SolidKinematics,
        materials: Mapping[str, Material],
        element: ElementPair,
        through_time: bool,
        bonus: int = 0,
        factor: Value = 1.0,
    ) -> None:
        self.factor = factor
        self.layout, self.gfu, self.kinematics, self.materials = layout, gfu, kinematics, dict(materials)
        self.mesh = gfu.space.mesh
        now = layout.fields(gfu)
        F = kinematics.gradient(now.u, ngs.Grad(now.u))
        self.history: History | None = None
        if through_time:
            regions = {name: material.viscous for name, material in materials.items()}
            self.history = History(self.mesh, regions, history_order(self.mesh, element.order))
            self.history.follow(isochoric(right_cauchy_green(F)))
            self.rules = dict(self.history.rules)
        else:
            shapes = {each.type for each in self.mesh.Elements()}
            self.rules = {shape: ngs.IntegrationRule(shape, 2 * element.order + bonus) for shape in shapes}
        self._det = ngs.Det(F).Compile()
        self.points = self.mesh.MapToAllElements(self.rules, ngs.VOL)
        self._relaxed, self._stiff = np.empty(0), False
        self.make()

    def make(self) -> None:
        """Make the forms; called again after a change of materials."""
        self.terms = self.energies()
        self._forces: InternalForces | None = None
        self.form: ngs.BilinearForm | None = None
        if self.history is not None:
            densities = {name: self.density(m, self.history.work) for name, m in self.materials.items()}
            self._forces = InternalForces(self.layout, self.gfu, densities, self.history.space, self.kinematics)
            return
        self.form = ngs.BilinearForm(self.gfu.space, symmetric=True)
        for term in self.terms:
            self.form += term
        self._vec = self.gfu.vec.CreateVector()

    def energies(self) -> list[ngs.comp.BFI]:
        """Energies of the regions, compiled: uncompiled, shared subexpressions are evaluated at every use."""
        trial = self.layout.fields(self.gfu.space.TrialFunction())
        state = Deformation.from_gradient(self.kinematics.gradient(trial.u, ngs.Grad(trial.u)))
        found = []
        for pattern, material in self.materials.items():
            if self.history is None:
                stored = material.energy(state, trial.p, self.factor)
            else:
                stored = self.density(material, self.history.energy)(state, trial.p)
            energy = (self.kinematics.weight() * stored).Compile()
            term = ngs.SymbolicEnergy(energy, definedon=self.mesh.Materials(pattern))
            for shape, rule in self.rules.items():
                term.SetIntegrationRule(shape, rule)
            found.append(term)
        return found

    def density(self, material: Material, remembered: HistoryEnergy) -> Density:
        """Energy density in the current time step.

        Parameters
        ----------
        material : Material
        remembered : callable
            `History.energy`, or `History.work` for forces alone.

        Returns
        -------
        callable
            From a `Deformation` and p to Pa.
        """
        law, history = material.viscous, self.history
        assert history is not None

        def density(at: Deformation, p: CoefficientFunction | None) -> CoefficientFunction:
            at, volume = material.elastic_part(at, self.factor)
            energy = law.density(at, history.shares[: len(law.hereditary_branches)]) + remembered(law, at.shape)
            return volume * (energy + material.volumetric_energy(at.J, p))

        return density

    def leave_out(self, elements: Array) -> None:
        """Exclude some elements (a mask) from all further integrals."""
        assert self._forces is not None
        for term in self.terms:  # `dx(definedonelements=…)` has no effect on an energy; its integrator's has
            term.SetDefinedOnElements(ngs.BitArray(~elements))
        self._forces.leave_out(self.points_in(elements))

    def forces(self) -> Array:
        """Nodal forces (N) and residuals of the pressure equations at the current state, one number for each unknown."""
        if self._forces is not None:
            return self._forces()
        assert self.form is not None
        self.form.Apply(self.gfu.vec, self._vec)
        if not np.isfinite(self.form.Energy(self.gfu.vec)):
            raise Breakdown("the energy is not finite", Status.NOT_FINITE)
        return np.array(self._vec.FV().NumPy())

    @property
    def stress(self) -> Array:
        """Nominal stress P = ∂W/∂F (Pa), (n, 3, 3) at the history's points, at the last call of `forces`."""
        assert self._forces is not None
        return self._forces.stress

    def min_det(self) -> float:
        """Smallest det F over all quadrature points at the current state."""
        return float(np.min(self._det(self.points)))

    def points_in(self, elements: Array) -> Array:
        """Numbers of the quadrature points in some elements (a mask)."""
        counts = np.array([len(self.rules[each.type].weights) for each in self.mesh.Elements()])
        return np.flatnonzero(np.repeat(elements, counts))

    # Internal variables. Maxwell branches are solved for at every state; their stiffness is computed for the tangent only.

    def reset(self) -> None:
        """Reset to the unloaded state."""
        if self.history is not None:
            self.history.reset()

    def begin(self, dt: float) -> None:
        """Begin a time step of `dt` seconds."""
        if self.history is not None:
            self.history.begin(dt)
        self._relaxed = np.empty(0)

    def update(self) -> None:
        """Solve for the Maxwell branches at the current unknowns."""
        if self.history is not None and self.history.maxwell and not np.array_equal(x := self._x(), self._relaxed):
            self.history.relax()
            self._relaxed, self._stiff = x, False

    def finish(self) -> None:
        """Update the internal variables at the end of the step."""
        if self.history is not None:
            self.update()
            self.history.finish()

    def stiffen(self, where: Array | slice = EVERYWHERE) -> None:
        """Compute the stiffness of the branches, everywhere or at some points."""
        if self.history is not None and self.history.maxwell and not self._stiff:
            self.history.maxwell.stiffen(where)
            self._stiff = where is EVERYWHERE

    def _x(self) -> Array:
        return np.array(self.gfu.vec.FV().NumPy())

    @property
    def internal(self) -> Mapping[str, Any]:
        """H_k, S̄_k of hereditary branches, C_v of Maxwell ones, and C̄."""
        return {} if self.history is None else self.history.internal

    @internal.setter
    def internal(self, saved: Mapping[str, Any]) -> None:
        if self.history is not None:
            self.history.internal = saved

    @property
    def frozen(self) -> Mapping[str, Any]:
        """Coefficients of the energy of the current step, with the branches solved at the current unknowns."""
        return {} if self.history is None else self.history.frozen

    @frozen.setter
    def frozen(self, saved: Mapping[str, Any]) -> None:
        if self.history is not None:
            self.history.frozen = saved
        self._relaxed, self._stiff = self._x(), True


def history_order(mesh: ngs.Mesh, k: int) -> int:
    """Half the order of the history's quadrature.

    With one point fewer in each direction quadrilaterals and hexahedra have hourglass modes.

    Parameters
    ----------
    mesh : ngsolve.Mesh
    k : int
        Order of the displacements.

    Returns
    -------
    int
    """
    simplices = {each.type for each in mesh.Elements()} <= {ngs.TRIG, ngs.TET}
    return max(k - simplices, 1)
