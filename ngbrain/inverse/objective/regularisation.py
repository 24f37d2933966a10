"""What is thought of a field before it is measured: smooth, of few flat parts, alike inside a label.

Each is an energy of x, a field in the variables of `parameters`, drawn to x̄; its matrix enters a Gauss-Newton step. Energies
φ(|∇x|²) are differentiated by NGSolve; where φ is not linear, the matrix is that of the last x (lagged diffusivity).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable

import ngsolve as ngs
import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg
from ngsolve import CoefficientFunction
from ngsolve.comp import IntegrationRuleSpace

from ngbrain.errors import InputError
from ngbrain.forward.common.interpolation import evaluation
from ngbrain.solvers.matrices import to_scipy

Array = np.ndarray
NEAR = 1e-8
"""Of the body: points that are the same."""
HELD = 1e-2
"""Share of the mass matrix that keeps a constant from costing nothing, over the squared size of the body."""
ROUGHEST = 1.0
"""Weight of `smooth` and `total_variation` at least: below it logarithms of moduli vary by a factor of about e from place to place,
more than tissue does, and follow whatever in the data is no wave of the model."""


class QuadraticRegulariser:
    """½ (x - x̄)·R (x - x̄) of one matrix R; `least` is the weight that no rule of weights goes below."""

    def __init__(self, matrix: sp.csr_array, reference: Array | float, min_weight: float = 0.0) -> None:
        self._matrix, self.min_weight = matrix, min_weight
        self.reference = np.broadcast_to(np.asarray(reference, float), (matrix.shape[0],))

    def matrix(self, block: Array) -> sp.csr_array:
        """R."""
        return self._matrix

    def value(self, block: Array) -> float:
        """The energy."""
        off = block - self.reference
        return 0.5 * float(off @ (self._matrix @ off))

    def gradient(self, block: Array) -> Array:
        """Its gradient."""
        return self._matrix @ (block - self.reference)

    def hvp(self, block: Array, direction: Array) -> Array:
        """R times a direction."""
        return self._matrix @ direction


def ridge(reference: Array) -> QuadraticRegulariser:
    """½ |x - x̄|²: for few values, such as one for each label.

    >>> ridge(np.zeros(2)).value(np.array([1.0, 1.0]))
    1.0
    """
    return QuadraticRegulariser(sp.eye_array(len(reference), format="csr"), reference)


def smooth(
    space: ngs.FESpace, reference: Array | float, weight: CoefficientFunction | float = 1.0
) -> QuadraticRegulariser:
    """½ ∫ w |∇(x - x̄)|² and a little of ½ ∫ (x - x̄)²/L², times L^(2-d) with L the body's size: H1, without a unit.

    `weight` w may be any CoefficientFunction, such as one that is small between labels.
    """
    return QuadraticRegulariser(_Gradients(space).matrix(weight), reference, ROUGHEST)


def matern(space: ngs.FESpace, reference: Array | float, length: float) -> QuadraticRegulariser:
    """½ (x - x̄)·(ℓ²K + M) M⁻¹ (ℓ²K + M)(x - x̄)/ℓᵈ: Gaussian fields with correlations over ℓ (m), Matérn's of ν = 2 - d/2.

    M⁻¹ is lumped. Smoother than H1: for fields without edges. Raises `InputError` unless ℓ is positive.
    Source: Lindgren, Rue, Lindström 2011, 10.1111/j.1467-9868.2011.00777.x.
    """
    if not length > 0:
        raise InputError("length", length, "a positive length in m")
    gradients = _Gradients(space)
    whole = length**2 * gradients.stiffness(1.0) + gradients.mass
    return QuadraticRegulariser(
        sp.csr_array(whole @ gradients.lumped_inverse() @ whole / length**space.mesh.dim), reference
    )


class LaggedDiffusivityRegulariser:
    """½ ∫ φ(|∇(x - x̄)|²), with φ growing and bending down so that a step costs less than a slope as high; else as `smooth`.

    `energy` is φ, of a CoefficientFunction (1/m²).
    """

    min_weight = ROUGHEST

    def __init__(
        self,
        space: ngs.FESpace,
        reference: Array | float,
        energy: Callable[[CoefficientFunction], CoefficientFunction],
    ) -> None:
        self.space, self.reference = space, np.broadcast_to(np.asarray(reference, float), (space.ndof,))
        self._gradients, self._field = _Gradients(space), ngs.GridFunction(space)
        gradient = ngs.Grad(self._field)
        squared = ngs.InnerProduct(gradient, gradient).MakeVariable()
        self._energy = energy(squared)
        self._diffusivity = self._energy.Diff(squared)
        self._along = ngs.GridFunction(space)
        turned = self._diffusivity.Diff(squared) * ngs.InnerProduct(gradient, ngs.Grad(self._along)) * gradient
        self._turned = ngs.LinearForm(2 * ngs.InnerProduct(turned, ngs.Grad(space.TestFunction())) * self._gradients.dx)

    def matrix(self, block: Array) -> sp.csr_array:
        """R with the diffusivity φ' of these x."""
        self._field.vec.FV().NumPy()[:] = block - self.reference
        return self._gradients.matrix(self._diffusivity)

    def value(self, block: Array) -> float:
        """The energy."""
        off = block - self.reference
        self._field.vec.FV().NumPy()[:] = off
        steep = ngs.Integrate(self._energy * self._gradients.dx, self.space.mesh)
        return 0.5 * (self._gradients.scale * float(steep) + float(off @ (self._gradients.held @ off)))

    def gradient(self, block: Array) -> Array:
        """Its gradient."""
        return self.matrix(block) @ (block - self.reference)

    def hvp(self, block: Array, direction: Array) -> Array:
        """The energy's second derivative times a direction: R's, less what a slope that grows costs less."""
        R = self.matrix(block)  # and the field is that of the block
        self._along.vec.FV().NumPy()[:] = direction
        self._turned.Assemble()
        return R @ direction + self._gradients.scale * self._turned.vec.FV().NumPy()


def total_variation(space: ngs.FESpace, reference: Array | float, edge: float) -> LaggedDiffusivityRegulariser:
    """∫ √(|∇x|² + 1/ℓ²) - 1/ℓ, times 1/ℓ: over a length ℓ = `edge` (m) x may change by one at no more cost than H1's.

    Raises `InputError` unless ℓ is positive. Sources: Rudin, Osher, Fatemi 1992, 10.1016/0167-2789(92)90242-F; lagged
    diffusivity: Vogel and Oman 1996, 10.1137/0917016.
    """
    if not edge > 0:
        raise InputError("edge", edge, "a positive length in m")
    floor = 1 / edge
    return LaggedDiffusivityRegulariser(space, reference, lambda s: 2 * floor * (ngs.sqrt(s + floor**2) - floor))


def nodes(space: ngs.FESpace) -> Array:
    """Points (ndof, dim) m, a lattice in each element, at which a function of an H1 space may take any values."""
    line = np.linspace(0, 1, space.globalorder + 1)
    cube = [point for point in itertools.product(line, repeat=space.mesh.dim)]
    simplex = [point for point in cube if sum(point) < 1 + 1e-9]
    rules = {}
    for shape in {el.type for el in space.mesh.Elements()}:
        points = simplex if shape in (ngs.ET.TRIG, ngs.ET.TET) else cube
        rules[shape] = ngs.IntegrationRule(points=points, weights=[0.0] * len(points))
    position = ngs.CF((ngs.x, ngs.y, ngs.z)[: space.mesh.dim])
    found = np.asarray(position(space.mesh.MapToAllElements(rules, ngs.VOL)))
    close = NEAR * np.ptp(found, axis=0).max()
    return found[np.unique(np.round(found / close), axis=0, return_index=True)[1]]


class _Gradients:
    """Matrices of a space: mass, stiffness with a weight, and what regularisers make of them."""

    def __init__(self, space: ngs.FESpace) -> None:
        self.space = space
        # One rule for energies and matrices, so that one is the other's slope on quadrilaterals too.
        self.dx = ngs.dx(intrules=IntegrationRuleSpace(space.mesh, order=space.globalorder).GetIntegrationRules())
        corners = np.array([vertex.point for vertex in space.mesh.vertices])
        extent = float(np.max(np.ptp(corners, axis=0)))
        self.scale = extent ** (2 - space.mesh.dim)
        trial, test = space.TnT()
        self.mass = self._assembled(trial * test)
        self.held = self.scale * HELD / extent**2 * self.mass

    def stiffness(self, weight: CoefficientFunction | float) -> sp.csr_array:
        trial, test = self.space.TnT()
        return self._assembled(weight * ngs.InnerProduct(ngs.Grad(trial), ngs.Grad(test)))

    def matrix(self, weight: CoefficientFunction | float) -> sp.csr_array:
        return sp.csr_array(self.scale * self.stiffness(weight) + self.held)

    def lumped_inverse(self) -> sp.csr_array:
        """M⁻¹ of a mass matrix that is diagonal in values at nodes, with the diagonal of M's scaled to the body's size.

        In values: of higher order unknowns are none, and a diagonal in them is no mass. Scaled diagonals are positive.
        Source: Hinton, Rock, Zienkiewicz 1976, 10.1002/eqe.4290040305.
        """
        at = evaluation(self.space, nodes(self.space))
        back = at.T  # of first order unknowns are values
        if self.space.globalorder > 1:
            back = scipy.sparse.linalg.spsolve(sp.csc_array(at), sp.eye_array(at.shape[0], format="csc"))
        back = sp.csc_array(back)
        diagonal = np.asarray(back.multiply(self.mass @ back).sum(axis=0)).ravel()
        diagonal *= ngs.Integrate(1.0, self.space.mesh) / diagonal.sum()
        return sp.csr_array(back @ sp.diags_array(1 / diagonal) @ back.T)

    def _assembled(self, integrand: CoefficientFunction) -> sp.csr_array:
        form = ngs.BilinearForm(self.space)
        form += integrand * self.dx
        form.Assemble()
        return to_scipy(form.mat)
