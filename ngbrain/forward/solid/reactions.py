"""Reaction forces of supports, contacts and loads, and other quantities of a problem's state."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import ngsolve as ngs
import numpy as np
from ngsolve import CoefficientFunction

from ngbrain.forward.common.loads import CavityVolume, volume
from ngbrain.forward.common.regions import boundaries
from ngbrain.forward.common.state import Term
from ngbrain.forward.contact.friction import FrictionTerm
from ngbrain.forward.solid.discretisation import MixedDiscretisation
from ngbrain.forward.solid.external_loads import ExternalLoads
from ngbrain.forward.solid.inertia import InertiaTerm
from ngbrain.forward.solid.tissue import TissueTerm

Array = np.ndarray


class Reactions(MixedDiscretisation):
    """Forces and energies of a `Problem` at its current state."""

    tissue: TissueTerm
    friction: FrictionTerm
    inertia: InertiaTerm | None
    external: ExternalLoads
    form: ngs.BilinearForm
    terms: tuple[Term, ...]
    gaps: list[Callable[[], Array]]
    _cavities: list[CavityVolume]

    @property
    def energy(self) -> float:
        """Energy (J; in plane strain per metre) of the body and of loads that have one."""
        return float(self.form.Energy(self.gfu.vec))

    def min_gap(self) -> float:
        """Smallest signed distance (m) between tissue and rigid bodies over the walls' quadrature points."""
        return min((float(np.min(gaps())) for gaps in self.gaps), default=float("inf"))

    def tissue_forces(self) -> Array:
        """Forces (N) that the tissue exerts on its nodes at the current state, one for each displacement unknown."""
        self._set_unknowns(self.x)
        return self.tissue.forces()[self.is_u]

    def tissue_stress(self) -> Array:
        """Nominal stress P = ∂W/∂F (Pa), (n, 3, 3) at the points of `history.space`, at the last call of `tissue_forces`."""
        return self.tissue.stress

    def contact_forces(self) -> Array:
        """Nodal forces (N) of contacts, their friction, sliding walls and loads at the current state."""
        return self._outer_forces()[self.is_u]

    def contact_energy(self) -> float:
        """Energy (J) stored in the penalties of contacts and sliding walls, and in loads, at the current state."""
        return float(self.external.form.Energy(self.gfu.vec))

    def friction_forces(self) -> Array:
        """Nodal forces (N) of friction alone, one for each displacement unknown."""
        return np.broadcast_to(self.friction.forces(), self.is_u.shape)[self.is_u]

    def friction_work(self) -> float:
        """Frictional work (J) since the start of the current time step."""
        return self.friction.work()

    def friction_driving_force(self) -> float:
        """Contribution of friction to the driving force (N) of the rigid bodies along their travel."""
        return self.friction.driving_force()

    def nodal_forces(self, boundary: str) -> Array:
        """External forces (N) on a boundary, loads on it included, one for each displacement unknown.

        They balance the internal forces, body forces, and forces of loads on other boundaries at shared nodes. A reaction is
        divided among the supports that constrain the node's component, see `Supports.shares`.
        """
        return self.unshared_forces(boundary) * self.reaction_shares(boundary)

    def unshared_forces(self, boundary: str, tissue: Array | None = None) -> Array:
        """As `nodal_forces`, where no support shares a node with others.

        Parameters
        ----------
        boundary : str
            Name or pattern.
        tissue : array, optional
            `tissue_forces`, where already computed.

        Returns
        -------
        array
            In newtons, one for each displacement unknown.
        """
        forces = self.tissue_forces() if tissue is None else tissue
        for pattern, acting in self.acting:
            if not self._on(boundary, pattern):
                forces = forces + self._applied(acting)[self.is_u]
        if self.inertia is not None:
            forces = forces + self.inertia.forces()
        return forces

    def reaction_shares(self, boundary: str) -> Array:
        """Share of a boundary in the force at each displacement unknown, see `Supports.shares`.

        It is 0 at free unknowns of a boundary on which nothing acts: the residual there is no force.
        """
        shares = self.supports.shares(self.u.space, boundary)
        own = any(self._on(boundary, pattern) for pattern, _ in self.acting)
        return shares if own else np.where(self.fixed, shares, 0.0)

    def _on(self, boundary: str, pattern: str | None) -> bool:
        """Whether a load's boundary pattern matches a boundary; False for loads without a boundary."""
        if pattern is None:
            return False
        if (boundary, pattern) not in self._meeting:
            meets = bool(boundaries(self.mesh, boundary) & boundaries(self.mesh, pattern))
            self._meeting[boundary, pattern] = meets
        return self._meeting[boundary, pattern]

    def force(self, boundary: str) -> Array:
        """Components of the total external force (N) on a boundary: of its supports, contacts and loads."""
        return np.array([self.conjugate(_unit(i, self.mesh.dim), boundary) for i in range(self.mesh.dim)])

    def conjugate(self, motion: CoefficientFunction, boundary: str) -> float:
        """Generalised force: work (J) of the external forces on a boundary for a unit of a motion.

        Parameters
        ----------
        motion : CoefficientFunction
            Motion of the boundary (m).
        boundary : str
            Name or pattern.

        Returns
        -------
        float
        """
        field = ngs.GridFunction(self.u.space)
        field.Set(motion, definedon=self.mesh.Boundaries(boundary), dual=True)
        return float(field.vec.FV().NumPy() @ self.nodal_forces(boundary))

    def volume(self, boundary: str) -> float:
        """Volume (m³; in plane strain m²) enclosed by a cavity's boundary, of the meshed part."""
        return volume(self.external.place(self.u, self.u), self.u, boundary)

    def cavity_pressures(self) -> list[float]:
        """Pressures (Pa) of the loads that prescribe a volume, in their order."""
        n = len(self._cavities)
        return self.gfu.vec.FV().NumPy()[self.fes.ndof - n :].tolist()

    def kinetic_energy(self) -> float:
        """∫ ρ/2 |v|² (J); 0 without inertia."""
        return 0.0 if self.inertia is None else self.inertia.energy()

    def _outer_forces(self) -> Array:
        """Forces of contacts, friction and loads, one number for each unknown."""
        if not self.external.contacts and not self.external.loads:
            return np.zeros(self.fes.ndof)
        return self._applied(self.external.form) + self.friction.forces()

    def _set_unknowns(self, x: Array) -> None:
        """Set the unknowns, and update what depends on them within a time step."""
        self.x = x
        for term in self.terms:
            term.update()

    @cached_property
    def _meeting(self) -> dict[tuple[str, str], bool]:
        """Function that tells whether two boundary patterns share a boundary."""
        return {}

    @cached_property
    def acting(self) -> list[tuple[str | None, ngs.BilinearForm]]:
        """External actions, one by one: boundary pattern, and form of the forces."""
        return [part for term in self.terms for part in term.boundary_forms()]


def _unit(i: int, dim: int) -> CoefficientFunction:
    return ngs.CF(tuple(float(i == j) for j in range(dim)))
