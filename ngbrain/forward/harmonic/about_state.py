"""The matrix of small waves about the equilibrium of a deformed body.

About an equilibrium u₀ of the energy E, E'(u₀) = 0, the body moves as u₀ + Re(v e^{iωt}), with v = g on driven boundaries and

    A v = b ,    A = E''(u₀) + iη W_iso''(u₀) - ω² M

where E'' is the tangent of all energies, initial stress included (acoustoelasticity), and the loss factor η multiplies the
tangent of the isochoric energy: G* = μ (1 + iη) at rest. All terms are symbolic derivatives of the energies.

Source: Ogden 2007, 10.1007/978-3-211-73572-5_1.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import ngsolve as ngs
import numpy as np

from ngbrain.errors import InputError
from ngbrain.forward.contact.rigid import offsets
from ngbrain.forward.harmonic.integrands import complex_space
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.solid.virtual_work import FieldState, Terms, VirtualWork
from ngbrain.materials.base import Deformation, Value, check_parameter, check_positive, density
from ngbrain.solvers.device import AUTO, CPU, PIVOTED, Device

Array = np.ndarray


class AboutState:
    """Matrices of small waves about a body's equilibrium.

    Parameters
    ----------
    body : Problem
        Elastic, at equilibrium.
    loss : float or CoefficientFunction
        Loss factor η.
    density : float or CoefficientFunction
        ρ (kg/m³) at rest.

    Raises
    ------
    InputError
        For a viscoelastic body.
    """

    def __init__(self, body: Problem, loss: Value, density: Value) -> None:
        if any(material.viscous.branches for material in body.materials.values()):
            raise InputError("body", "a viscoelastic one", "an elastic one; `loss` sets the attenuation of waves")
        self.body = body
        self.loss = check_parameter(loss, "loss", lambda ratio: ratio >= 0, "a number of at least 0")
        self.density = check_positive(density, "density")
        self.work = VirtualWork(body)

    def supports(self) -> dict[str, str]:
        """Fixed boundaries of the body: a pattern for each axis."""
        return {name[-1]: pattern for name, pattern in self.body.supports.dirichlet.items()}

    def space(self, displacement: ngs.FESpace) -> ngs.FESpace:
        """Space of complex amplitudes of all unknowns, in the order of the body's own space."""
        body, layout = self.body, self.body.layout
        if layout.single:
            return displacement
        parts = [displacement, *(complex_space(part) for part in body.fes.components[1 : 1 + layout.pressure])]
        if layout.offset:
            parts.append(offsets(body.mesh, body.contacts, body.element.order, complex=True))
        if layout.cavities:
            parts += [complex_space(part) for part in body.fes.components[layout.count - layout.cavities :]]
        return ngs.FESpace(parts)

    def pivoting_device(self, device: Device) -> Device:
        """Device that factorises nonsymmetric matrices."""
        if device not in (CPU, AUTO):
            raise InputError("device", repr(device.name), "'cpu': follower pressures make the matrices nonsymmetric")
        return PIVOTED

    def matrices(self, space: ngs.FESpace) -> Callable[[float], ngs.BaseMatrix]:
        """From ω (rad/s) to A at the body's state."""
        still, moving, lossy = (np.array(form().AsVector().FV().NumPy()) if form else 0.0 for form in self._forms)
        pattern = self._pattern(space)

        def combined(omega: float) -> ngs.BaseMatrix:
            matrix = pattern.CreateMatrix()
            matrix.AsVector().FV().NumPy()[:] = still - omega**2 * moving + 1j * lossy
            return matrix

        return combined

    def _pattern(self, space: ngs.FESpace) -> ngs.BaseMatrix:
        """A complex matrix with the sparsity pattern."""
        u, v = (part if self.body.layout.single else part[0] for part in space.TnT())
        places = u[0] * v[0] * ngs.dx
        if self.body.layout.offset:
            places += u[0] * v[0] * ngs.ds
        return ngs.BilinearForm(places).Assemble().mat

    @cached_property
    def _forms(self) -> list[Callable[[], ngs.BaseMatrix] | None]:
        """Forms of the three parts; None for an absent one, such as the loss."""
        (state, test), work = self.body.fes.TnT(), self.work
        parts = (
            work(state, test),
            work.functional(self.kinetic, state, test),
            work.functional(self.lossy, state, test),
        )
        return [derivative_by_state(self.body, each) if each else None for each in parts]

    def kinetic(self, at: FieldState) -> ngs.comp.SumOfIntegrals:
        """ρ/2 u·u."""
        return at.kinematics.weight() * self.density / 2 * ngs.InnerProduct(at.u, at.u) * at.dx(".*")

    def lossy(self, at: FieldState) -> ngs.comp.SumOfIntegrals:
        """η times the isochoric energy."""
        body, deformation = self.body, Deformation.from_gradient(at.F)
        first, *rest = (
            at.kinematics.weight()
            * self.loss
            * density(m.elastic, deformation)
            * ngs.dx(definedon=body.mesh.Materials(pattern), intrules=body.tissue.rules)
            for pattern, m in body.materials.items()
        )
        return sum(rest, first)


def derivative_by_state(body: Problem, parts: Terms) -> Callable[[], ngs.BaseMatrix]:
    """Assembler of the derivative, with respect to the state, of terms with trial functions as the state and test functions.

    Parameters
    ----------
    body : Problem
    parts : list of WorkIntegral

    Returns
    -------
    callable
        Gives the matrix at the body's current state.
    """
    form = ngs.BilinearForm(body.fes)
    for part in parts:
        form += part.integral
    if body.layout.offset:  # the same sparsity pattern for all of them, with or without boundary terms
        u, v = (body.layout.fields(of).u for of in body.fes.TnT())
        form += ngs.Parameter(0.0) * u[0] * v[0] * ngs.ds

    def assembled() -> ngs.BaseMatrix:
        form.AssembleLinearization(body.gfu.vec)
        return form.mat

    return assembled
