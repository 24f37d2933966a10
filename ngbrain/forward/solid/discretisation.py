"""Finite-element discretisation of a problem: elements, unknowns, Dirichlet values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import ngsolve as ngs
import numpy as np

from ngbrain.arguments import check_type
from ngbrain.forward.common.dirichlet import Support, Supports
from ngbrain.forward.common.element_choice import choose_element
from ngbrain.forward.common.elements import ElementPair, check_elements
from ngbrain.forward.common.kinematics import SolidKinematics, kinematics_of
from ngbrain.forward.common.material import Material, stiffness
from ngbrain.forward.common.unknowns import Layout
from ngbrain.forward.contact.force_control import ForceControlledTool
from ngbrain.forward.contact.rigid import RigidContact, offsets
from ngbrain.forward.solid.tissue import history_order
from ngbrain.solvers import linear

Array = np.ndarray
CONDENSE_UP_TO = 1e6
"""K/μ up to which discontinuous pressures are eliminated element by element; beyond it elimination loses accuracy."""


class MixedDiscretisation:
    """Finite-element spaces and unknowns of a problem.

    Parameters
    ----------
    mesh, materials, conditions, element, kinematics
        See `Problem`.
    through_time : bool
        Whether tissue has internal variables at its quadrature points.
    rigid : sequence of RigidContact
        Contacts, whose offsets are unknowns.
    cavities : int
        Number of cavity pressures.
    """

    tool: ForceControlledTool | None = None

    def __init__(
        self,
        mesh: ngs.Mesh,
        materials: Mapping[str, Material],
        conditions: Mapping[str, Support],
        element: str | ElementPair,
        kinematics: SolidKinematics | None,
        through_time: bool,
        rigid: Sequence[RigidContact],
        cavities: int,
    ) -> None:
        self.mesh, self.materials = mesh, dict(materials)
        self.kinematics, self.supports = kinematics_of(mesh, kinematics), Supports(mesh, conditions)
        instant = {name: Material(m.viscous.instantaneous, m.bulk) for name, m in materials.items()}
        asked = element if isinstance(element, ElementPair) else None if element == "auto" else self._named(element)
        points = history_order(mesh, asked.order if asked else 2) if through_time else None
        self._moduli, self.modulus, self.ratio = stiffness(mesh, instant, points)
        if asked is None:
            self.element, why = choose_element(mesh, self.ratio, self.supports.components)
        else:
            self.element, why = asked, "as given, unchecked" if isinstance(element, ElementPair) else "asked for"
        self.choice = {"element": f"{self.element}: {why}"}
        self._condense = self.element.kind == "discontinuous pressure" and self.ratio <= CONDENSE_UP_TO
        spaces = self.element.spaces(mesh, self._condense, **self.supports.dirichlet)
        self.layout = Layout(self.element.pressure is not None, bool(rigid), cavities)
        if rigid:
            spaces.append(offsets(mesh, rigid, self.element.order))
        spaces += [ngs.NumberSpace(mesh) for _ in range(cavities)]
        self.fes = spaces[0] if len(spaces) == 1 else ngs.FESpace(spaces)
        self.gfu = ngs.GridFunction(self.fes)
        self._unknowns = self.gfu.vec.FV().NumPy()
        self._vec = self.gfu.vec.CreateVector()
        now = self.layout.fields(self.gfu)
        self.u, self.p, self.offset = now.u, now.p, now.offset
        self._looks = [look for each in rigid if (look := each.follow(self.u))]
        check_elements(mesh)
        self.prescribed, self.fixed = self.supports.coefficients(spaces[0])
        part = np.repeat(np.arange(self.layout.count), [space.ndof for space in spaces])
        self.is_u = part == 0
        self._lengths = self.is_u | (bool(rigid) & (part == 1 + self.layout.pressure))

    def _named(self, element: str) -> ElementPair:
        check_type("element", element, str)
        named = ElementPair.named(element)
        named.check(self.mesh)
        return named

    @property
    def x(self) -> Array:
        """All unknowns as one array, a copy: those of `fes`, then the travel (m) of a force-controlled tool."""
        unknowns = self._unknowns.copy()
        return unknowns if self.tool is None else np.append(unknowns, self.tool.travel)

    @x.setter
    def x(self, x: Array) -> None:
        self._unknowns[:] = x[: len(self._unknowns)]
        if self.tool is not None:
            self.tool.travel = x[-1]
        for look in self._looks:
            look()

    def _applied(self, form: ngs.BilinearForm) -> Array:
        """First variation of a form at the current unknowns, one number per unknown."""
        form.Apply(self.gfu.vec, self._vec)
        return np.array(self._vec.FV().NumPy())

    def _linear_solver(self, pivots: str, contacts: bool) -> linear.Choice:
        """Choice of the linear solver; `pivots` is the reason why pivoting is needed, if any."""
        if pivots:
            return linear.Choice("umfpack", f"{pivots}, which needs a factorisation with pivoting")
        if contacts:
            return linear.Choice("sparsecholesky", "contact zones change, which preconditioners do not cope with")
        coupled = int(np.sum(np.fromiter(self.fes.FreeDofs(self._condense), bool)))
        return linear.choose(self.element.kind, coupled, self.ratio, dim=self.mesh.dim, order=self.element.order)
