"""Derivatives of one time step with respect to node positions.

What is in an element moves with its nodes. A shift δ changes a gradient ∇u, with fixed degrees of freedom, by -∇u ∇δ, a volume by
the factor 1 + div δ, and a material's coefficients by their gradient along δ where they depend on position. Internal variables
are values at points that move along.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import reduce
from operator import add
from typing import Any

import ngsolve as ngs
import numpy as np
import scipy.sparse as sp
from ngsolve import CoefficientFunction

from ngbrain.errors import InputError
from ngbrain.forward.common.material import Material
from ngbrain.forward.sensitivity.node_positions import NodePositions
from ngbrain.forward.sensitivity.transient.quadrature_blocks import (
    QuadratureFunction,
    set_rows,
    unknowns,
    weighted_functions,
)
from ngbrain.forward.sensitivity.transient.step import UNPERTURBED, StepForms
from ngbrain.forward.solid.virtual_work import Motion, Terms, WorkIntegral, vector
from ngbrain.materials.base import Deformation
from ngbrain.solvers.matrices import to_scipy

Array = np.ndarray
PLACE = (ngs.x, ngs.y, ngs.z)


class StepShapeDerivatives:
    """Derivatives of time steps with respect to node positions, after `forms.begin`.

    Parameters
    ----------
    forms : StepForms
        Derivatives of the step.
    nodes : NodePositions
        The node positions.

    Raises
    ------
    InputError
        For a body that is not 3-D with pressures.
    """

    def __init__(self, forms: StepForms, nodes: NodePositions) -> None:
        self._forms, self._n, self._r, body = forms, ngs.Parameter(0.0), ngs.Parameter(0.0), forms.body
        if body.mesh.dim != 3 or body.p is None:
            wanted = "a 3-D body with pressures, for derivatives of a run with respect to node positions"
            raise InputError("body", f"{body.element} in {body.mesh.dim} dimensions", wanted)
        space = nodes.shift.space
        self._motion, self._way = ngs.GridFunction(body.fes), ngs.GridFunction(space)
        self._matrix = ngs.BilinearForm(trialspace=space, testspace=body.fes)
        for term in self._over(lambda m: self._work(m, body.fes.TestFunction(), space.TrialFunction())):
            self._matrix += term.integral
        test = space.TestFunction()
        self._work_slopes = vector(space, self._over(lambda m: self._work(m, self._motion.components, test)))
        self._kept_slopes = vector(space, self._over(lambda m: self._weighed(m, test)))
        ends = {p: self._ends(m, self._way) for p, m in body.materials.items()}
        self._moved = body.mesh.MaterialCF({p: ngs.CF((0.0, *parts)).Compile() for p, parts in ends.items()})

    def force_jacobian(self) -> sp.csr_array:
        """Derivative of the tissue's nodal forces with respect to the shifts (ndof, shifts)."""
        self._matrix.Assemble()
        return to_scipy(self._matrix.mat)

    def history_derivative(self, shifts: Array) -> Array:
        """Derivative of the history at the end along shifts (size, points)."""
        unknowns(self._way)[:] = shifts
        return self._forms.points(self._moved)[1:]

    def adjoint_gradient(self, motion: Array, weights: Array) -> Array:
        """Transposed products of both.

        Parameters
        ----------
        motion : array (ndof,)
            Weights of the forces.
        weights : array (size, points)
            Weights of the history.

        Returns
        -------
        array (shifts,)
        """
        unknowns(self._motion)[:] = motion
        set_rows(self._forms.blocks, "weight", weights)
        return self._work_slopes() + self._kept_slopes()

    def _over(self, of: Callable[[Material], CoefficientFunction]) -> Terms:
        """Integrals over the regions."""
        body = self._forms.body
        return [
            WorkIntegral(of(material), ngs.dx(definedon=body.mesh.Materials(pattern), intrules=body.history.rules))
            for pattern, material in body.materials.items()
        ]

    def _work(self, material: Material, virtual: Sequence[Any], way: CoefficientFunction) -> CoefficientFunction:
        """Shape derivative of the virtual work's integrand."""
        body = self._forms.body
        F = self._F(body.u, way) + self._r * self._gradient(virtual[0], way)
        energies = self._forms.energies(
            material, Deformation.from_gradient(F), 1.0 * body.p + self._r * virtual[1], UNPERTURBED
        )
        work = reduce(add, (part.value for part in energies)).Diff(self._r)
        return self._along(work, way) + work * ngs.Trace(ngs.Grad(way))

    def _ends(self, material: Material, way: CoefficientFunction) -> list[CoefficientFunction]:
        """Shape derivative of the history's blocks."""
        updates = self._forms.updates(
            material, Deformation.from_gradient(self._F(self._forms.body.u, way)).shape, UNPERTURBED
        )
        return [self._along(part.value, way) for part in updates]

    def _weighed(self, material: Material, way: CoefficientFunction) -> CoefficientFunction:
        blocks, parts = self._forms.blocks, map(QuadratureFunction, self._ends(material, way))
        return reduce(add, (part.value for part in weighted_functions(blocks, parts)), ngs.CF(0.0))

    def _along(self, function: CoefficientFunction, way: CoefficientFunction) -> CoefficientFunction:
        """Derivative of a function at a point that moves."""
        return reduce(add, (function.Diff(PLACE[i], way[i]) for i in range(3)), function.Diff(self._n))

    def _F(self, u: Motion, way: CoefficientFunction) -> CoefficientFunction:  # noqa: N802
        return ngs.Id(3) + self._gradient(u, way)

    def _gradient(self, u: Motion, way: CoefficientFunction) -> CoefficientFunction:
        return ngs.Grad(u) - self._n * ngs.Grad(u) * ngs.Grad(way)
