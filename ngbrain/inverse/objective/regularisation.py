"""Regularisers of a field: H1 smoothness, total variation, Matérn covariance, ridge.

Each regulariser is an energy of x, a field in the variables of `parameters`, relative to a reference x̄. Its matrix enters the
Gauss-Newton step. Energies φ(|∇x|²) are differentiated by NGSolve; where φ is not linear, the matrix is that of the current
iterate (lagged diffusivity).
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
"""Relative distance, of the size of the domain, below which two points are the same."""
MASS_SHARE = 1e-2
"""Share of the mass matrix that is added so that constants have a cost, over the squared size of the domain."""
MIN_WEIGHT = 1.0
"""Smallest weight of `smooth` and `total_variation`. Below it logarithms of moduli vary by a factor of about e from place to
place, more than tissue does, and fit errors of the data that the model cannot represent.
"""


class QuadraticRegulariser:
    """Quadratic regulariser ½ (x - x̄)·R (x - x̄) with a constant matrix R.

    Parameters
    ----------
    matrix : sparse array (n, n)
        R, symmetric positive semi-definite.
    reference : array (n,) or float
        Reference x̄.
    min_weight : float
        Weight that no weight selection goes below.
    """

    def __init__(self, matrix: sp.csr_array, reference: Array | float, min_weight: float = 0.0) -> None:
        self._matrix, self.min_weight = matrix, min_weight
        self.reference = np.broadcast_to(np.asarray(reference, float), (matrix.shape[0],))

    def matrix(self, block: Array) -> sp.csr_array:
        """Matrix R."""
        return self._matrix

    def value(self, block: Array) -> float:
        """Energy."""
        off = block - self.reference
        return 0.5 * float(off @ (self._matrix @ off))

    def gradient(self, block: Array) -> Array:
        """Gradient of the energy."""
        return self._matrix @ (block - self.reference)

    def hvp(self, block: Array, direction: Array) -> Array:
        """Hessian-vector product R δx.

        Parameters
        ----------
        block : array (n,)
            Unknowns of the field.
        direction : array (n,)
            Direction δx.

        Returns
        -------
        array (n,)
            R δx.
        """
        return self._matrix @ direction


def ridge(reference: Array) -> QuadraticRegulariser:
    """Ridge (Tikhonov) regulariser ½ |x - x̄|², for few values such as one per label.

    >>> ridge(np.zeros(2)).value(np.array([1.0, 1.0]))
    1.0
    """
    return QuadraticRegulariser(sp.eye_array(len(reference), format="csr"), reference)


def smooth(
    space: ngs.FESpace, reference: Array | float, weight: CoefficientFunction | float = 1.0
) -> QuadraticRegulariser:
    """H1 regulariser ½ ∫ w |∇(x - x̄)|² plus a small share of ½ ∫ (x - x̄)²/L².

    The energy is multiplied by L^(2-d), L being the size of the domain, so that it has no unit.

    Parameters
    ----------
    space : FESpace
        Space of the field.
    reference : array (n,) or float
        Reference x̄.
    weight : CoefficientFunction or float
        Local weight w, for example small at the interfaces between labels.

    Returns
    -------
    QuadraticRegulariser
    """
    return QuadraticRegulariser(_Gradients(space).matrix(weight), reference, MIN_WEIGHT)


def matern(space: ngs.FESpace, reference: Array | float, length: float) -> QuadraticRegulariser:
    """Regulariser of a Gaussian field with Matérn covariance: ½ (x - x̄)·(ℓ²K + M) M⁻¹ (ℓ²K + M)(x - x̄)/ℓᵈ.

    The smoothness is ν = 2 - d/2 and M⁻¹ is lumped. Fields are smoother than with H1: for fields without edges.

    Parameters
    ----------
    space : FESpace
        Space of the field.
    reference : array (n,) or float
        Reference x̄.
    length : float
        Correlation length ℓ (m).

    Returns
    -------
    QuadraticRegulariser

    Raises
    ------
    InputError
        If the length is not positive.

    References
    ----------
    Lindgren, Rue, Lindström 2011, 10.1111/j.1467-9868.2011.00777.x.
    """
    if not length > 0:
        raise InputError("length", length, "a positive length in m")
    gradients = _Gradients(space)
    whole = length**2 * gradients.stiffness(1.0) + gradients.mass
    return QuadraticRegulariser(
        sp.csr_array(whole @ gradients.lumped_inverse() @ whole / length**space.mesh.dim), reference
    )


class LaggedDiffusivityRegulariser:
    """Edge-preserving regulariser ½ ∫ φ(|∇(x - x̄)|²) with a concave, increasing φ, so that a step costs less than a slope of
    the same height.

    The small share of the mass matrix and the scale are those of `smooth`.

    Parameters
    ----------
    space : FESpace
        Space of the field.
    reference : array (n,) or float
        Reference x̄.
    energy : callable
        φ, a function of a CoefficientFunction (1/m²).
    """

    min_weight = MIN_WEIGHT

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
        self._direction = ngs.GridFunction(space)
        change = self._diffusivity.Diff(squared) * ngs.InnerProduct(gradient, ngs.Grad(self._direction)) * gradient
        self._tangent = ngs.LinearForm(
            2 * ngs.InnerProduct(change, ngs.Grad(space.TestFunction())) * self._gradients.dx
        )

    def matrix(self, block: Array) -> sp.csr_array:
        """Matrix R with the diffusivity φ' of the given x."""
        self._field.vec.FV().NumPy()[:] = block - self.reference
        return self._gradients.matrix(self._diffusivity)

    def value(self, block: Array) -> float:
        """Energy."""
        off = block - self.reference
        self._field.vec.FV().NumPy()[:] = off
        energy = ngs.Integrate(self._energy * self._gradients.dx, self.space.mesh)
        return 0.5 * (self._gradients.scale * float(energy) + float(off @ (self._gradients.mass_share @ off)))

    def gradient(self, block: Array) -> Array:
        """Gradient of the energy."""
        return self.matrix(block) @ (block - self.reference)

    def hvp(self, block: Array, direction: Array) -> Array:
        """Hessian-vector product: R δx plus the derivative of the diffusivity.

        Parameters
        ----------
        block : array (n,)
            Unknowns of the field.
        direction : array (n,)
            Direction δx.

        Returns
        -------
        array (n,)
            Second derivative of the energy times δx.
        """
        R = self.matrix(block)  # also sets the field to that of the block
        self._direction.vec.FV().NumPy()[:] = direction
        self._tangent.Assemble()
        return R @ direction + self._gradients.scale * self._tangent.vec.FV().NumPy()


def total_variation(space: ngs.FESpace, reference: Array | float, edge: float) -> LaggedDiffusivityRegulariser:
    """Smoothed total variation ∫ (√(|∇x|² + 1/ℓ²) - 1/ℓ), times 1/ℓ.

    Over a length ℓ, x may change by one at no more cost than with H1.

    Parameters
    ----------
    space : FESpace
        Space of the field.
    reference : array (n,) or float
        Reference x̄.
    edge : float
        Width ℓ of an edge (m).

    Returns
    -------
    LaggedDiffusivityRegulariser

    Raises
    ------
    InputError
        If the width is not positive.

    References
    ----------
    Rudin, Osher, Fatemi 1992, 10.1016/0167-2789(92)90242-F. Lagged diffusivity: Vogel and Oman 1996, 10.1137/0917016.
    """
    if not edge > 0:
        raise InputError("edge", edge, "a positive length in m")
    floor = 1 / edge
    return LaggedDiffusivityRegulariser(space, reference, lambda s: 2 * floor * (ngs.sqrt(s + floor**2) - floor))


def nodes(space: ngs.FESpace) -> Array:
    """Lagrange nodes (ndof, dim) in m: a lattice of points in each element at which an H1 function may take any values."""
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
    """Mass and stiffness matrices of a space, and the matrices that regularisers make of them."""

    def __init__(self, space: ngs.FESpace) -> None:
        self.space = space
        # The same quadrature rule for energies and matrices, so that gradients are exact on quadrilaterals too.
        self.dx = ngs.dx(intrules=IntegrationRuleSpace(space.mesh, order=space.globalorder).GetIntegrationRules())
        corners = np.array([vertex.point for vertex in space.mesh.vertices])
        extent = float(np.max(np.ptp(corners, axis=0)))
        self.scale = extent ** (2 - space.mesh.dim)
        trial, test = space.TnT()
        self.mass = self._assemble(trial * test)
        self.mass_share = self.scale * MASS_SHARE / extent**2 * self.mass

    def stiffness(self, weight: CoefficientFunction | float) -> sp.csr_array:
        trial, test = self.space.TnT()
        return self._assemble(weight * ngs.InnerProduct(ngs.Grad(trial), ngs.Grad(test)))

    def matrix(self, weight: CoefficientFunction | float) -> sp.csr_array:
        return sp.csr_array(self.scale * self.stiffness(weight) + self.mass_share)

    def lumped_inverse(self) -> sp.csr_array:
        """Inverse of a lumped mass matrix, which is diagonal in nodal values; its diagonal is scaled to the size of the domain.

        Nodal values are used because the coefficients of higher-order elements are not values, and a diagonal in them is no mass.
        The scaled diagonal is positive.

        References
        ----------
        Hinton, Rock, Zienkiewicz 1976, 10.1002/eqe.4290040305.
        """
        at = evaluation(self.space, nodes(self.space))
        back = at.T  # first-order coefficients are values
        if self.space.globalorder > 1:
            back = scipy.sparse.linalg.spsolve(sp.csc_array(at), sp.eye_array(at.shape[0], format="csc"))
        back = sp.csc_array(back)
        diagonal = np.asarray(back.multiply(self.mass @ back).sum(axis=0)).ravel()
        diagonal *= ngs.Integrate(1.0, self.space.mesh) / diagonal.sum()
        return sp.csr_array(back @ sp.diags_array(1 / diagonal) @ back.T)

    def _assemble(self, integrand: CoefficientFunction) -> sp.csr_array:
        form = ngs.BilinearForm(self.space)
        form += integrand * self.dx
        form.Assemble()
        return to_scipy(form.mat)
