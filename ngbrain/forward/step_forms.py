"""How one time step of a relaxing body changes with the history it starts from, with its parameters and with its end.

A step finds x with R(x; h, θ) = 0 and ends with the history h⁺ = U(x, h; θ), all of it at quadrature points. With a motion λ and
weights Λ, densities at these points, everything that an adjoint needs is a derivative of one integrand,

    ℓ = W'(x; h, θ)[λ] + Λ · U(x, h; θ) ,

by h, θ and x; what a linearisation needs are the directional derivatives of W' and U. W and U are the material's own, with
e_k and β_k as functions of Δt/τ_k, so that parameters may stand anywhere in them.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import reduce
from operator import add
from typing import TypeAlias

import ngsolve as ngs
import numpy as np
from ngsolve import CoefficientFunction

from ngbrain.errors import InputError
from ngbrain.forward.body import Body
from ngbrain.forward.forces import Density, Forces
from ngbrain.forward.material import Material
from ngbrain.materials.base import Deformation, Value
from ngbrain.tensors import deformation_gradient, of_six, six

Array = np.ndarray
Parameter: TypeAlias = ngs.GridFunction | ngs.Parameter
"""A scalar real GridFunction or an `ngs.Parameter` that materials are made of."""
SERIES = 0.05
"""Δt/τ below which β is its series: beyond it 1 - e^-x keeps its digits, also in the derivative."""


def factors(dt: Value, tau: Value) -> tuple[CoefficientFunction, CoefficientFunction]:
    """e = exp(-Δt/τ) and β = (1 - e)/(Δt/τ) as `materials.viscous.step_factors` has them, to be differentiated.

    >>> e, beta = factors(ngs.Parameter(1e-9), ngs.Parameter(2.0))
    >>> beta.dim
    1
    """
    x = dt / tau * ngs.CF(1.0)
    series: CoefficientFunction = ngs.CF(1.0)
    for n in range(10, 1, -1):  # Σ (-x)ⁿ/(n + 1)!
        series = 1 - x / n * series
    e = ngs.exp(-x)
    return e, ngs.IfPos(x - SERIES, (1 - e) / x, series)


class Block:
    """Variables at quadrature points that go together: values, their change, and their weights Λ; each (size, points)."""

    def __init__(self, space: ngs.FESpace, size: int) -> None:
        self.value, self.change, self.weight = (ngs.GridFunction(ngs.VectorValued(space, size)) for _ in range(3))
        self.size = size
        self.variable = entries(self.value).MakeVariable()


def entries(field: ngs.GridFunction) -> CoefficientFunction:
    """The components of a field with a space of its own for each."""
    return ngs.CF(tuple(field[i] for i in range(field.dim)))


class StepForms:
    """Derivatives of a step of `body` by its history and by `parameters` (name → GridFunction or Parameter).

    The history is one array (size, points): for each hereditary branch S̄_k, then H_k. Call `begin` for a step, put the body to its
    end, and ask; all sums over points carry their quadrature weights. Raises `InputError` for a parameter that is neither.
    """

    def __init__(self, body: Body, parameters: Mapping[str, Parameter]) -> None:
        self.body, self.parameters = body, dict(parameters)
        history = body.history
        self.points, space = history.points, history.space
        self.dt = ngs.Parameter(1.0)
        self.blocks = [Block(space, 6) for _ in range(2 * history.n_branches)]
        self.size = sum(block.size for block in self.blocks)
        one = ngs.GridFunction(ngs.L2(body.mesh, order=0))
        one.Set(1.0)
        self._one, self._directions = one, {name: _direction(name, p) for name, p in self.parameters.items()}
        rules = history.rules
        self.quadrature = (
            ngs.LinearForm(space.TestFunction() * ngs.dx(intrules=rules)).Assemble().vec.FV().NumPy().copy()
        )
        self._motion, self._moving = ngs.GridFunction(body.fes), ngs.GridFunction(body.fes)
        materials = body.materials
        self._changed = Forces(body.gfu, {p: self._changing(m) for p, m in materials.items()}, space)
        self._remembered = Forces(body.gfu, {p: self._weighted(m) for p, m in materials.items()}, space)
        self._back = body.mesh.MaterialCF({p: self._backward(m) for p, m in materials.items()})
        self._forth = body.mesh.MaterialCF({p: self._forward(m) for p, m in materials.items()})
        self._slopes = {name: self._slope(p) for name, p in self.parameters.items() if isinstance(p, ngs.GridFunction)}

    # What is asked of a step.

    def begin(self, history: Array, dt: float) -> None:
        """A step of `dt` seconds from a history."""
        self.dt.Set(dt)
        self._put("value", history)

    def changed(self, history: Array, theta: Mapping[str, Array]) -> Array:
        """∂R/∂h δh + ∂R/∂θ δθ, one number for each unknown of the body."""
        self._put("change", history)
        self._aim(theta)
        return self._changed()

    def moved(self, x: Array, history: Array, theta: Mapping[str, Array]) -> Array:
        """δh⁺ = ∂U/∂x δx + ∂U/∂h δh + ∂U/∂θ δθ."""
        self._put("change", history)
        self._aim(theta)
        _values(self._moving)[:] = x
        return self.points(self._forth) if self.size else history

    def remembered(self, weights: Array) -> Array:
        """(∂U/∂x)ᵀΛ, one number for each unknown of the body."""
        self._put("weight", weights)
        return self._remembered() if self.size else np.zeros(self.body.fes.ndof)

    def back(self, motion: Array, weights: Array) -> tuple[Array, dict[str, Array]]:
        """∂ℓ/∂h as a density at the points, and ∂ℓ/∂θ for each parameter's unknowns."""
        self._put("weight", weights)
        _values(self._motion)[:] = motion
        found = self.points(self._back)
        slopes = {}
        for name, slope in zip(self.parameters, found[self.size :], strict=True):
            if name in self._slopes:
                field, form = self._slopes[name]
                _values(field)[:] = slope
                form.Assemble()
                slopes[name] = form.vec.FV().NumPy().copy()
            else:
                slopes[name] = np.array([self.quadrature @ slope])
        return found[: self.size], slopes

    # How they are made.

    def _factors(self, material: Material) -> list[tuple[CoefficientFunction, CoefficientFunction]]:
        return [factors(self.dt, branch.tau) for branch in material.viscous.hereditary]

    def _density(self, material: Material, at: Deformation, p: CoefficientFunction) -> CoefficientFunction:
        """W of a step, as `Body` has it."""
        law = material.viscous
        both = self._factors(material)
        energy = law.density(at, [beta for _, beta in both]) + material.of_volume(at.J, p)
        for (e, beta), stress, over in zip(both, self.blocks[0::2], self.blocks[1::2], strict=False):
            pull = of_six(e * over.variable - beta * stress.variable)
            energy += 0.5 * ngs.InnerProduct(pull, at.shape)
        return energy

    def _updates(self, material: Material, shape: CoefficientFunction) -> list[CoefficientFunction]:
        """U at a C̄, block by block; branches that a region has not stay at rest."""
        found, branches = [], material.viscous.hereditary
        for k, (stress, over) in enumerate(zip(self.blocks[0::2], self.blocks[1::2], strict=True)):
            if k < len(branches):
                e, beta = factors(self.dt, branches[k].tau)
                new = six(branches[k].stress(shape))
                found += [new, e * over.variable + beta * (new - stress.variable)]
            else:
                found += [ngs.CF((0.0,) * 6), ngs.CF((0.0,) * 6)]
        return found

    def _along(self, function: CoefficientFunction) -> CoefficientFunction:
        """Change of a function with history and parameters."""
        parts = [function.Diff(block.variable, entries(block.change)) for block in self.blocks]
        parts += [function.Diff(p, self._directions[name]) for name, p in self.parameters.items()]
        return reduce(add, parts)

    def _changing(self, material: Material) -> Density:
        return lambda at, p: self._along(self._density(material, at, p))

    def _weighted(self, material: Material) -> Density:
        def density(at: Deformation, p: CoefficientFunction) -> CoefficientFunction:
            return self._sum(self._updates(material, at.shape)) + 0 * p

        return density

    def _sum(self, updates: list[CoefficientFunction]) -> CoefficientFunction:
        """Λ · U."""
        parts = [ngs.InnerProduct(entries(b.weight), u) for b, u in zip(self.blocks, updates, strict=True)]
        return reduce(add, parts, ngs.CF(0.0))

    def _backward(self, material: Material) -> CoefficientFunction:
        """∂ℓ/∂h and ∂ℓ/∂θ."""
        F = deformation_gradient(self.body.u).MakeVariable()
        p, at = (1.0 * self.body.p).MakeVariable(), Deformation.of(F)
        W = self._density(material, at, p)
        u, q, _ = self._motion.components
        work = W.Diff(F, ngs.Grad(u)) + W.Diff(p, q) + self._sum(self._updates(material, at.shape))
        parts = [work.Diff(block.variable) for block in self.blocks]
        for parameter in self.parameters.values():
            field = isinstance(parameter, ngs.GridFunction)
            parts.append(work.Diff(parameter, self._one) if field else work.Diff(parameter))
        return ngs.CF(tuple(parts)).Compile()

    def _forward(self, material: Material) -> CoefficientFunction:
        """δh⁺."""
        if not self.blocks:
            return ngs.CF(0.0)
        F = deformation_gradient(self.body.u).MakeVariable()
        shape = Deformation.of(F).shape
        moving = shape.Diff(F, ngs.Grad(self._moving.components[0])).Reshape((9,))
        held = shape.MakeVariable()
        updates = self._updates(material, held)
        # By all of C̄ and then along its change: a derivative along a change has no memory of what parts of it share.
        parts = [u.Diff(held).Reshape((u.dim, 9)) * moving + self._along(u) for u in updates]
        return ngs.CF(tuple(parts)).Compile()

    def _slope(self, parameter: ngs.GridFunction) -> tuple[ngs.GridFunction, ngs.LinearForm]:
        """From a density at points to a number for each unknown of a field."""
        field = ngs.GridFunction(self.body.history.space)
        form = ngs.LinearForm(parameter.space)
        form += field * parameter.space.TestFunction() * ngs.dx(intrules=self.body.history.rules)
        return field, form

    def _put(self, what: str, values: Array) -> None:
        end = 0
        for block in self.blocks:
            _values(getattr(block, what))[:] = values[end : end + block.size].ravel()
            end += block.size

    def _aim(self, theta: Mapping[str, Array]) -> None:
        for name, direction in self._directions.items():
            if isinstance(direction, ngs.GridFunction):
                _values(direction)[:] = theta[name]
            else:
                direction.Set(float(theta[name][0]))


def _direction(name: str, parameter: Parameter) -> Parameter:
    if isinstance(parameter, ngs.GridFunction):
        if parameter.space.is_complex or parameter.dim != 1:
            raise InputError(f"parameters.{name}", "complex or a vector", "a real scalar field")
        return ngs.GridFunction(parameter.space)
    if not isinstance(parameter, ngs.Parameter):
        raise InputError(
            f"parameters.{name}", repr(parameter), "a GridFunction or an ngs.Parameter that laws are made of"
        )
    return ngs.Parameter(0.0)


def _values(field: ngs.GridFunction) -> Array:
    return field.vec.FV().NumPy()
