"""One time step of a viscoelastic body: first derivatives with respect to history, parameters and end state.

From a history h, a step computes m = P(h; θ) (what its Maxwell branches start from), solves R(x; h, m, θ) = 0 and ends with the
history h⁺ = U(x, h, m; θ). All but x are fields at quadrature points. With a motion λ and weights Λ and M (densities), an adjoint
needs derivatives of two integrands with respect to h, θ and x,

    ℓ = W'(x; h, m, θ)[λ] + Λ · U(x, h, m; θ)        and        M · P(h; θ) ,    M = ∂ℓ/∂m .

A tangent needs directional derivatives of W', U and P. These are the material's own functions, with e_k and β_k as functions of
Δt/τ_k, so that parameters may enter anywhere.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import reduce
from operator import add, attrgetter
from typing import Any, TypeAlias

import ngsolve as ngs
import numpy as np
from ngsolve import CoefficientFunction

from ngbrain.errors import InputError
from ngbrain.forward.common.material import Material
from ngbrain.forward.sensitivity.transient.maxwell_step import (
    MaxwellEnd,
    MaxwellStart,
    ParameterPerturbation,
    step_factors,
)
from ngbrain.forward.sensitivity.transient.quadrature_blocks import (
    Expressions,
    QuadratureBlock,
    QuadratureFunction,
    set_rows,
    unknowns,
    weighted_functions,
)
from ngbrain.forward.solid.internal_forces import Density, InternalForces
from ngbrain.forward.solid.problem import Problem
from ngbrain.materials.base import Deformation, density
from ngbrain.materials.viscous import overstress
from ngbrain.tensors import from_voigt, to_voigt

Array = np.ndarray
Parameter: TypeAlias = ngs.GridFunction | ngs.Parameter
"""A parameter of materials: a scalar real GridFunction, or an `ngs.Parameter`."""
View: TypeAlias = Callable[[QuadratureBlock], CoefficientFunction]
UNPERTURBED, PERTURBED = attrgetter("variable"), attrgetter("perturbed")
"""Blocks as variables to differentiate with respect to, and as perturbed along a direction."""


class StepForms:
    """Derivatives of a time step of a body with respect to its history and to parameters.

    A history is one array (size, points): S̄_k and H_k of each hereditary branch, then, with Maxwell branches, C̄ and each G.
    Call `begin` with the body at the end of a step before asking for derivatives. Sums over points include quadrature weights.

    Parameters
    ----------
    body : Problem
        The body.
    parameters : dict of str to GridFunction or Parameter
        Parameters of its materials.

    Raises
    ------
    InputError
        For a parameter of another kind, or one that a material uses through its gradient.
    """

    def __init__(self, body: Problem, parameters: Mapping[str, Parameter]) -> None:
        self.body, self.parameters = body, dict(parameters)
        history, space = body.history, body.history.space
        self.points, self.dt = history.points, ngs.Parameter(1.0)
        branches = range(len(history.maxwell.branches))
        self._s = ngs.Parameter(0.0)
        self._pairs = [
            (QuadratureBlock(space, 6, self._s), QuadratureBlock(space, 6, self._s)) for _ in range(history.n_branches)
        ]
        self._strain = [QuadratureBlock(space, 6, self._s)] if branches else []
        self._G, self._half, self._converged = (
            [QuadratureBlock(space, size, self._s) for _ in branches] for size in (9, 10, 5)
        )
        self.blocks = [block for pair in self._pairs for block in pair] + self._strain + self._G
        self.size = sum(block.size for block in self.blocks)
        self.strains = slice(12 * len(self._pairs), self.size)
        """Where C̄ and the G are in a history."""
        self._directions = {name: _direction(name, p) for name, p in self.parameters.items()}
        for material in body.materials.values():
            self._check(material)
        self.update_quadrature()
        self._motion, self._state_change = ngs.GridFunction(body.fes), ngs.GridFunction(body.fes)
        materials, of = body.materials, body.mesh.MaterialCF
        self._residual_change = self.nodal_forces({p: self._work_change(m) for p, m in materials.items()})
        self._weighted_update = self.nodal_forces({p: self._weighted_updates(m) for p, m in materials.items()})
        self._adjoint_fields = of({p: self._adjoint_expressions(m) for p, m in materials.items()})
        self._update_change = of({p: self._update_expressions(m) for p, m in materials.items()})
        self._start_adjoint_fields = of({p: self._start_adjoint_expressions(m) for p, m in materials.items()})
        self._start_change = of({p: self._start_expressions(m) for p, m in materials.items()})
        self._forms = {
            name: self._gradient_form(p) for name, p in self.parameters.items() if isinstance(p, ngs.GridFunction)
        }

    def update_quadrature(self) -> None:
        """Compute the quadrature weights on the mesh as it is."""
        test, rules = self.body.history.space.TestFunction(), self.body.history.rules
        self.quadrature = unknowns(
            ngs.LinearForm(self.body.kinematics.weight() * test * ngs.dx(intrules=rules)).Assemble()
        ).copy()

    def nodal_forces(self, densities: dict[str, Density]) -> InternalForces:
        """Nodal forces of energy densities (region → `Density`) at the body's state."""
        body = self.body
        return InternalForces(body.layout, body.gfu, densities, body.history.space, body.kinematics)

    def deformation_gradient(self, u: CoefficientFunction) -> CoefficientFunction:
        """Deformation gradient F of a displacement."""
        return self.body.kinematics.gradient(u, ngs.Grad(u))

    @property
    def p(self) -> CoefficientFunction | None:
        """The pressure as an expression, if there is one."""
        return None if self.body.p is None else 1.0 * self.body.p

    def perturbed_state(
        self, F: CoefficientFunction, p: CoefficientFunction | None, *changes: tuple[ngs.Parameter, Any]
    ) -> tuple[Deformation, CoefficientFunction | None]:
        """A state perturbed along motions.

        Parameters
        ----------
        F : CoefficientFunction
            Deformation gradient.
        p : CoefficientFunction or None
            Pressure (Pa).
        *changes : tuple of Parameter and Motion
            A number that is zero, and the motion that it multiplies.

        Returns
        -------
        Deformation, CoefficientFunction or None
        """
        for number, motion in changes:
            change = self.body.layout.fields(motion)
            F = F + number * self.body.kinematics.change(change.u, ngs.Grad(change.u))
            p = None if p is None else p + number * change.p
        return Deformation.from_gradient(F), p

    # Derivatives of a step.

    def begin(self, memory: Mapping[str, Any], dt: float) -> None:
        """Start a step; the body is at its end.

        Parameters
        ----------
        memory : dict
            `History.internal` at the start.
        dt : float
            Time step (s).
        """
        self.dt.Set(dt)
        history = [row for k in range(len(self._pairs)) for row in (memory["stress"][k], memory["overstress"][k])]
        if self._strain:
            history += [memory["strain"], *(G.reshape(-1, 9).T for G in memory["inner"])]
        self.history = np.vstack([np.zeros((0, len(self.quadrature))), *history])
        set_rows(self.blocks, "value", self.history)
        self.read_maxwell_states()

    def read_maxwell_states(self) -> None:
        """Read from the Maxwell branches their start and their solution."""
        for branch, half, converged in zip(
            self.body.history.maxwell.branches, self._half, self._converged, strict=True
        ):
            set_rows([half], "value", branch.step_state)
            set_rows([converged], "value", branch.step_solution)

    def residual_derivative(self, history: Array, theta: Mapping[str, Array]) -> Array:
        """R_h δh + R_m δm + R_θ δθ.

        Parameters
        ----------
        history : array (size, points)
            δh.
        theta : dict of str to array
            δθ.

        Returns
        -------
        array (ndof,)
        """
        self.set_direction(history, theta)
        return self._residual_change()

    def history_derivative(self, x: Array) -> Array:
        """δh⁺ for δx, with δh and δθ of the last `residual_derivative`."""
        unknowns(self._state_change)[:] = x
        return self.points(self._update_change)[1:]

    def history_state_gradient(self, weights: Array) -> Array:
        """(∂U/∂x)ᵀ Λ (ndof,)."""
        set_rows(self.blocks, "weight", weights)
        return self._weighted_update() if self.size else np.zeros(self.body.fes.ndof)

    def adjoint_gradients(self, motion: Array, weights: Array) -> tuple[Array, dict[str, Array]]:
        """Gradients of ℓ with respect to h and to each parameter.

        Parameters
        ----------
        motion : array (ndof,)
            λ.
        weights : array (size, points)
            Λ.

        Returns
        -------
        by_history : array (size, points)
            A density at the points.
        by_theta : dict of str to array
            By degrees of freedom of each parameter.
        """
        set_rows(self.blocks, "weight", weights)
        unknowns(self._motion)[:] = motion
        inner = sum(block.size for block in self._half)
        by_history, by_inner, by_theta = np.split(self.points(self._adjoint_fields)[1:], [self.size, self.size + inner])
        if inner:
            set_rows(self._half, "weight", by_inner)
            before = self.points(self._start_adjoint_fields)[1:]
            by_history, by_theta = by_history + before[: self.size], by_theta + before[self.size :]
        return by_history, self.assemble_gradient(by_theta)

    def assemble_gradient(self, densities: Array) -> dict[str, Array]:
        """Gradients with respect to degrees of freedom, from densities with respect to values at the points."""
        return {name: self._assemble_density(name, s) for name, s in zip(self.parameters, densities, strict=True)}

    def _assemble_density(self, name: str, density: Array) -> Array:
        if name not in self._forms:
            return np.array([self.quadrature @ density])
        at_points, form = self._forms[name]
        unknowns(at_points)[:] = density
        form.Assemble()
        return unknowns(form).copy()

    # Materials in a step.

    def _check(self, material: Material) -> None:
        """Derivatives are with respect to values at points: a material must not use a parameter's gradient, nor swell."""
        if material.swells:
            raise InputError("materials", "with swelling", "none that swells, for derivatives of a run in time")
        at = Deformation.from_gradient(self.deformation_gradient(self.body.u))
        branches = [
            ngs.CF((branch_end.law, branch_end.branch.eta))
            for branch_end in self._maxwell_ends(material, at.shape, UNPERTURBED)
        ]
        for name, parameter in self.parameters.items():
            if isinstance(parameter, ngs.GridFunction):
                for coefficients in (self.energies(material, at, self.p, UNPERTURBED)[0].value, *branches):
                    if re.search(
                        r"diffop = (?!Id\b)",
                        str(coefficients.Diff(parameter, parameter.space.TestFunction()).Compile()),
                    ):
                        raise InputError(
                            f"parameters.{name}",
                            "used through its gradient",
                            "a field of which materials use values only",
                        )

    def parameter_derivatives(self, function: CoefficientFunction) -> Expressions:
        """Derivatives of a function with respect to each parameter's value."""
        # Not along a direction: NGSolve then differentiates shared subexpressions again and again.
        return [function.Diff(parameter) for parameter in self.parameters.values()]

    def directional_derivative(self, function: CoefficientFunction) -> CoefficientFunction:
        """Derivative of a function along δθ."""
        changes = zip(self.parameter_derivatives(function), self._directions.values(), strict=True)
        return reduce(add, (slope * change for slope, change in changes), 0.0 * function)

    def _zero_function(self, size: int) -> QuadratureFunction:
        return QuadratureFunction(ngs.CF((0.0,) * size), [ngs.CF((0.0,) * size)] * len(self.parameters))

    def _parameter_perturbation(self, view: View) -> tuple[ParameterPerturbation, ...]:
        """Perturbation of a Maxwell branch's parameters, if anything is perturbed."""
        return (self._perturb_coefficients,) if view is PERTURBED else ()

    def _perturb_coefficients(self, coefficients: CoefficientFunction, law: CoefficientFunction) -> CoefficientFunction:
        """`coefficients` plus s times the change of `law` along δθ."""
        return coefficients + self._s * self.directional_derivative(law)

    def energies(
        self, material: Material, at: Deformation, p: CoefficientFunction, view: View
    ) -> list[QuadratureFunction]:
        """Energy density W, as in `Tissue`.

        Parameters
        ----------
        material : Material
            Material of a region.
        at : Deformation
            Deformation.
        p : CoefficientFunction
            Pressure.
        view : callable
            `UNPERTURBED` or `PERTURBED`: whether blocks are perturbed.

        Returns
        -------
        list of QuadratureFunction
            Parts of the density.
        """
        law = material.viscous
        factors = [step_factors(self.dt, branch.tau) for branch in law.hereditary_branches]
        energy = law.density(at, [beta for _, beta in factors]) + material.volumetric_energy(at.J, p)
        for (e, beta), (stress, over) in zip(factors, self._pairs, strict=False):
            energy += 0.5 * ngs.InnerProduct(from_voigt(e * view(over) - beta * view(stress)), at.shape)
        branches = (
            self._branch_function(branch_end.energy, branch_end, view)
            for branch_end in self._maxwell_ends(material, at.shape, view)
        )
        return [QuadratureFunction(energy, self.parameter_derivatives(energy)), *branches]

    def _maxwell_ends(self, material: Material, shape: CoefficientFunction, view: View) -> list[MaxwellEnd]:
        parts = zip(material.viscous.maxwell_branches, self._half, self._converged, strict=False)
        return [
            MaxwellEnd(branch, shape, view(half), converged.variable, *self._parameter_perturbation(view))
            for branch, half, converged in parts
        ]

    def _branch_function(
        self, value: CoefficientFunction, branch: MaxwellStart | MaxwellEnd, view: View
    ) -> QuadratureFunction:
        """A quantity of a Maxwell branch as a `QuadratureFunction`."""
        return (
            QuadratureFunction(value)
            if view is PERTURBED
            else QuadratureFunction(value, self.parameter_derivatives(branch.law), branch.coefficients)
        )

    def updates(self, material: Material, shape: CoefficientFunction, view: View) -> list[QuadratureFunction]:
        """Updated internal variables U, block by block; branches that a region does not have stay at rest.

        Parameters
        ----------
        material : Material
            Material of a region.
        shape : CoefficientFunction
            C̄.
        view : callable
            As in `energies`.

        Returns
        -------
        list of QuadratureFunction
        """
        functions, C = list[QuadratureFunction](), shape.MakeVariable()
        for branch, (stress, over) in zip(material.viscous.hereditary_branches, self._pairs, strict=False):
            W = density(branch.law, Deformation.from_stretch(C))
            new = QuadratureFunction(
                to_voigt(overstress(W, C)), [to_voigt(overstress(slope, C)) for slope in self.parameter_derivatives(W)]
            )
            factors = ngs.CF(step_factors(self.dt, branch.tau))
            coefficients = ngs.CF((factors, new.value)).MakeVariable()
            both = zip(self.parameter_derivatives(factors), new.slopes, strict=True)
            update = coefficients[0] * view(over) + coefficients[1] * (
                ngs.CF(tuple(coefficients[i] for i in range(2, 8))) - view(stress)
            )
            functions += [new, QuadratureFunction(update, [ngs.CF(slopes) for slopes in both], coefficients)]
        functions += [self._zero_function(6)] * (2 * len(self._pairs) - len(functions))
        if self._strain:
            branch_updates = [
                self._branch_function(branch_end.G, branch_end, view)
                for branch_end in self._maxwell_ends(material, shape, view)
            ]
            strain = replace(self._zero_function(6), value=to_voigt(shape))
            functions += [strain, *branch_updates, *[self._zero_function(9)] * (len(self._G) - len(branch_updates))]
        return functions

    def maxwell_starts(self, material: Material, view: View) -> list[MaxwellStart]:
        """Start of the step in each Maxwell branch.

        Parameters
        ----------
        material : Material
            Material of a region.
        view : callable
            As in `energies`.

        Returns
        -------
        list of MaxwellStart
        """
        functions = list[MaxwellStart]()
        for branch, G, converged in zip(material.viscous.maxwell_branches, self._G, self._converged, strict=False):
            nine, strain = view(G), from_voigt(view(self._strain[0]))
            three = ngs.CF(tuple(nine[i] for i in range(9)), dims=(3, 3))
            functions.append(
                MaxwellStart(branch, self.dt, strain, three, converged.variable, *self._parameter_perturbation(view))
            )
        return functions

    def _start_functions(self, material: Material, view: View) -> list[QuadratureFunction]:
        """P, block by block."""
        functions = [
            self._branch_function(branch_start.value, branch_start, view)
            for branch_start in self.maxwell_starts(material, view)
        ]
        return functions + [self._zero_function(10)] * (len(self._half) - len(functions))

    # Directional derivatives are with respect to one number, as those along a change repeat shared subexpressions.

    def _derivative_along_direction(self, part: QuadratureFunction) -> CoefficientFunction:
        """Derivative of a function along everything that is perturbed."""
        return part.directional_derivative(self._s, list(self._directions.values()))

    def _work_change(self, material: Material) -> Density:
        return lambda at, p: reduce(
            add, map(self._derivative_along_direction, self.energies(material, at, p, PERTURBED))
        )

    def _weighted_updates(self, material: Material) -> Density:
        return lambda at, p: reduce(
            add,
            (w.value for w in weighted_functions(self.blocks, self.updates(material, at.shape, UNPERTURBED))),
            0 * (at.J if p is None else p),
        )

    def _block_derivatives(
        self, parts: Sequence[QuadratureFunction], blocks: Sequence[QuadratureBlock]
    ) -> CoefficientFunction:
        """Derivatives of a sum with respect to blocks and to θ."""
        functions = [[*(part.value.Diff(b.variable) for b in blocks), *part.parameter_derivatives] for part in parts]
        return ngs.CF((0.0, *(reduce(add, of) for of in zip(*functions, strict=True)))).Compile()

    def _adjoint_expressions(self, material: Material) -> CoefficientFunction:
        """∂ℓ by h, m and θ."""
        F = self.deformation_gradient(self.body.u).MakeVariable()
        state, fixed = Deformation.from_gradient(F), Deformation.from_gradient(self.deformation_gradient(self.body.u))
        motion = self.body.layout.fields(self._motion)
        t = ngs.Parameter(0.0)
        names = ("shape", "C", "J", "F")
        # Variables: derivatives with respect to a block do not descend into them again.
        fixed_measures = [getattr(fixed, name).MakeVariable() for name in names]
        change = self.body.kinematics.change(motion.u, ngs.Grad(motion.u))
        changes = [getattr(state, name).Diff(F, change) for name in names]
        at = Deformation(*(part + t * change for part, change in zip(fixed_measures, changes, strict=True)))
        p = None if self.p is None else self.p.MakeVariable() + t * motion.p
        works = [W.apply(lambda part: part.Diff(t)) for W in self.energies(material, at, p, UNPERTURBED)]
        return self._block_derivatives(
            works + weighted_functions(self.blocks, self.updates(material, fixed_measures[0], UNPERTURBED)),
            [*self.blocks, *self._half],
        )

    def _update_expressions(self, material: Material) -> CoefficientFunction:
        """δh⁺."""
        state = self.body.layout.fields(self._state_change).u
        F = self.deformation_gradient(self.body.u) + self._s * self.body.kinematics.change(state, ngs.Grad(state))
        updates = self.updates(material, Deformation.from_gradient(F).shape, PERTURBED)
        return ngs.CF((0.0, *map(self._derivative_along_direction, updates))).Compile()

    def _start_adjoint_expressions(self, material: Material) -> CoefficientFunction:
        """∂(M · P) by h and θ."""
        return self._block_derivatives(
            weighted_functions(self._half, self._start_functions(material, UNPERTURBED)), self.blocks
        )

    def _start_expressions(self, material: Material) -> CoefficientFunction:
        """δm."""
        return ngs.CF(
            (0.0, *map(self._derivative_along_direction, self._start_functions(material, PERTURBED)))
        ).Compile()

    def _gradient_form(self, parameter: ngs.GridFunction) -> tuple[ngs.GridFunction, ngs.LinearForm]:
        at_points, form = ngs.GridFunction(self.body.history.space), ngs.LinearForm(parameter.space)
        weight = self.body.kinematics.weight()
        form += weight * at_points * parameter.space.TestFunction() * ngs.dx(intrules=self.body.history.rules)
        return at_points, form

    def set_direction(self, history: Array, theta: Mapping[str, Array]) -> None:
        """Set δh and δθ.

        Parameters
        ----------
        history : array (size, points)
            δh.
        theta : dict of str to array
            δθ.
        """
        set_rows(self.blocks, "change", history)
        for name, direction in self._directions.items():
            if isinstance(direction, ngs.GridFunction):
                unknowns(direction)[:] = theta[name]
            else:
                direction.Set(float(theta[name][0]))
        if self._half:
            set_rows(self._half, "change", self.points(self._start_change)[1:])


def _direction(name: str, parameter: Parameter) -> Parameter:
    if isinstance(parameter, ngs.GridFunction):
        if parameter.space.is_complex or parameter.dim != 1:
            raise InputError(f"parameters.{name}", "complex or a vector", "a real scalar field")
        return ngs.GridFunction(parameter.space)
    if not isinstance(parameter, ngs.Parameter):
        raise InputError(f"parameters.{name}", repr(parameter), "a GridFunction or an ngs.Parameter of the materials")
    return ngs.Parameter(0.0)
