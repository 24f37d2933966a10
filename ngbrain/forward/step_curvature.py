"""How what an adjoint of a time step is made of changes where its state, its history and its parameters move.

With ℓ of `step_forms` and the contacts' work C, what second derivatives need beside first ones is, for a motion λ + Zᵀw of the
tissue and λ of the contacts, weights Λ, and ways (δx, δh, δθ),

    ℓ' = d/ds ( W'(x + s δx; h + s δh, θ + s δθ)[λ + Zᵀw] + Λ · U(x + s δx, h + s δh; θ + s δθ) + C(x + s δx; θ + s δθ)[λ] )

by x, h and θ. Fields are moved by numbers and derived by these, see `implicit_work`.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import reduce
from operator import add

import ngsolve as ngs
import numpy as np
from ngsolve import CoefficientFunction

from ngbrain.errors import InputError
from ngbrain.forward.contact import Closing
from ngbrain.forward.contact_forms import ContactForms
from ngbrain.forward.forces import Density, Forces
from ngbrain.forward.implicit_blocks import Block
from ngbrain.forward.implicit_work import Motion, Terms, vector
from ngbrain.forward.material import Material
from ngbrain.forward.parts import Block as Variables
from ngbrain.forward.parts import entries, put, values, weighed
from ngbrain.forward.step_forms import StepForms
from ngbrain.materials.base import Deformation
from ngbrain.tensors import deformation_gradient

Array = np.ndarray


class StepCurvature:
    """Second derivatives of the steps of some `forms`, with parameters as `parts`; where `forms.begin` was called.

    Raises `InputError` for bodies with Maxwell branches, whose steps have minima of their own, and for walls that close on
    each other.
    """

    def __init__(self, forms: StepForms, parts: Mapping[str, Block], contacts: ContactForms) -> None:
        self._forms, self._parts, self._contacts, body = forms, list(parts.values()), contacts, forms.body
        if body.history.flows:
            raise InputError("body", "with Maxwell branches", "hereditary ones alone, for second derivatives in time")
        if any(isinstance(contact, Closing) for contact in body.contacts):
            raise InputError("body", "with walls that close on each other", "without, for second derivatives in time")
        self._adjoint, self._motion, self._way = (ngs.GridFunction(body.fes) for _ in range(3))
        self._r, self._s = ngs.Parameter(0.0), ngs.Parameter(0.0)
        touched, densities = self._touched(), {p: self._density(m) for p, m in body.materials.items()}
        self._by_contacts = vector(body.fes, self._touched(body.fes.TestFunction()))
        self._by_tissues = Forces(body.gfu, densities, body.history.space)
        self._back = body.mesh.MaterialCF({p: self._derived(m) for p, m in body.materials.items()})
        self._of_contacts = [part.slope(touched, body.mesh) for part in self._parts]

    def aim(self, state: Array, history: Array, theta: Mapping[str, Array]) -> None:
        """Ways δx (ndof,), δh (size, points) and δθ."""
        values(self._way)[:] = state
        self._forms.aim(history, theta)
        for part, way in zip(self._parts, theta.values(), strict=True):
            part.turn(way)

    def weigh(self, adjoint: Array, motion: Array, weights: Array) -> None:
        """λ, λ + Zᵀw and Λ."""
        values(self._adjoint)[:], values(self._motion)[:] = adjoint, motion
        put(self._forms.blocks, "weight", weights)

    def by_state(self) -> Array:
        """∂ℓ'/∂x, one number for each unknown of the body."""
        return self._by_tissues() + self._by_contacts()

    def back(self) -> tuple[Array, Array]:
        """∂ℓ'/∂h, a density at the points, and ∂ℓ'/∂θ, one part after the other."""
        by_history, by_theta = np.split(self._forms.points(self._back)[1:], [self._forms.size])
        tissues, contacts = self._forms.gathered(by_theta).values(), (slope() for slope in self._of_contacts)
        return by_history, np.concatenate([a + b for a, b in zip(tissues, contacts, strict=True)])

    def _touched(self, *tested: Motion) -> Terms:
        """The contacts' part of ℓ', or its derivative along a motion that is tested."""
        still = self._contacts.work(self._adjoint, *tested)
        along = [term for part in self._parts for term in part.along(still)]
        return self._contacts.work(self._adjoint, self._way, *tested) + along

    def _density(self, material: Material) -> Density:
        return lambda at, p: self._turned(self._work(material, at.F, p))

    def _derived(self, material: Material) -> CoefficientFunction:
        """A tissue's ℓ' by history and parameters."""
        work = self._work(material, deformation_gradient(self._forms.body.u), 1.0 * self._forms.body.p)
        turned, slopes = self._turned(work), zip(*map(self._forms.slopes, work), strict=True)
        by_history = [turned.Diff(block.variable) for block in self._forms.blocks]
        return ngs.CF((0.0, *by_history, *(self._turned(slope) for slope in slopes))).Compile()

    def _turned(self, work: tuple[CoefficientFunction, ...]) -> CoefficientFunction:
        """ℓ' of `_work`, or of its derivative by a parameter.

        Those by parameters are taken first, where there is least to derive.
        """

        def whole(energy: CoefficientFunction, kept: CoefficientFunction) -> CoefficientFunction:
            return energy.Diff(self._r) + kept

        return whole(*work).Diff(self._s) + whole(*map(self._forms.along, work))

    def _work(
        self, material: Material, F: CoefficientFunction, p: CoefficientFunction
    ) -> tuple[CoefficientFunction, CoefficientFunction]:
        """W as a function of r, by which λ + Zᵀw goes, and s, and Λ · U as one of s, at a state."""
        forms, way = self._forms, (self._s, self._way)
        energies = forms.energies(material, *_moved(F, p, (self._r, self._motion), way), self._seen)
        updates = forms.updates(material, _moved(F, p, way)[0].shape, self._seen)
        kept = (part.value for part in weighed(forms.blocks, updates))
        return reduce(add, (part.value for part in energies)), reduce(add, kept, ngs.CF(0.0))

    def _seen(self, block: Variables) -> CoefficientFunction:
        return block.variable + self._s * entries(block.change)


def _moved(
    F: CoefficientFunction, p: CoefficientFunction, *ways: tuple[ngs.Parameter, ngs.GridFunction]
) -> tuple[Deformation, CoefficientFunction]:
    """A state moved by numbers."""
    for number, motion in ways:
        u, q, _ = motion.components
        F, p = F + number * ngs.Grad(u), p + number * q
    return Deformation.of(F), p
