"""Positions of points in the loaded body, to find the unloaded (reference) shape."""

from __future__ import annotations

import ngsolve as ngs
import numpy as np
import scipy.sparse as sp

from ngbrain.errors import InputError
from ngbrain.forward.common.interpolation import evaluation
from ngbrain.forward.sensitivity.node_positions import NodePositions
from ngbrain.forward.sensitivity.static_model import StaticLinearisation, StaticModel

Array = np.ndarray


class Positions:
    """Model from θ to positions x = X + s(X) + u(X) under load, with s the displacement of the mesh's nodes.

    Parameters
    ----------
    model : StaticModel
        Bodies on one mesh. Each load case observes `Displacements(points)` and nothing else.
    nodes : str
        Name of its parameter of type `NodePositions`.
    points : array (n, 2 or 3)
        Points X (m) of the mesh as it was made. Data have all components of the first point first.

    Raises
    ------
    InputError
        Where the model has no such parameter or other observables.

    Examples
    --------
    >>> from ngbrain.forward.sensitivity.static_model import LoadCase
    >>> from ngbrain.forward.common.loads import BodyForce
    >>> from ngbrain.forward.common.material import Material
    >>> from ngbrain.forward.observables import Displacements
    >>> from ngbrain.forward.solid.problem import Problem
    >>> from ngbrain.materials import NeoHooke
    >>> from ngbrain.mesh.geometry.structured import rectangles
    >>> mesh = rectangles(np.linspace(0, 0.1, 3), np.linspace(0, 0.1, 3))
    >>> nodes, points = NodePositions(mesh), [[0.05, 0.0]]
    >>> body = Problem(mesh, {".*": Material(NeoHooke(1e3), 1e4)}, {"top": 0}, [BodyForce((0, -1e3))], element="P2")
    >>> model = Positions(StaticModel([LoadCase(body, [Displacements(points)])], {"nodes": nodes}), "nodes", points)
    >>> hanging = model.evaluate(np.zeros(nodes.size)).data
    >>> bool(abs(hanging[0] - 0.05) < 1e-9 and -0.01 < hanging[1] < 0)
    True
    """

    def __init__(self, model: StaticModel, nodes: str, points: Array) -> None:
        part, points = model.parts.get(nodes), np.asarray(points, float)
        if not isinstance(part, NodePositions):
            raise InputError("nodes", repr(nodes), "the name of a parameter NodePositions(mesh)")
        n, dim = points.shape
        if any(each.size != n * dim or not each.linear for each in model.equilibria):
            raise InputError(
                "model", "with other observables", f"only Displacements of the {n} points in each load case"
            )
        self.model, self.points = model, points
        scalar = evaluation(ngs.H1(part.mesh, order=1), points)
        by_point = np.arange(n * dim).reshape(dim, n).T.ravel()
        one = sp.csr_array(sp.block_diag([scalar] * dim, format="csr")[by_point])
        shifted = sp.vstack([one] * len(model.equilibria), format="csr")
        chosen = sp.eye_array(model.size, format="csr")[model.blocks[nodes]]
        self.shifts = sp.csr_array(shifted @ chosen)
        """∂s/∂θ at the points, of all load cases."""

    def evaluate(self, theta: Array) -> PositionsLinearisation:
        """Positions at θ, with their derivatives."""
        return PositionsLinearisation(self, self.model.evaluate(theta))


class PositionsLinearisation:
    """Positions at one θ and products with their Jacobian.

    Parameters
    ----------
    of : Positions
        The model.
    there : StaticLinearisation
        Equilibria at θ.
    """

    def __init__(self, of: Positions, there: StaticLinearisation) -> None:
        self._shifts, self._there = of.shifts, there
        self.data = np.tile(of.points.ravel(), len(there.states)) + self._shifts @ there.theta + there.data

    def jvp(self, direction: Array) -> Array:
        """Jacobian-vector product J δθ."""
        return np.asarray(self._there.jvp(direction) + self._shifts @ direction)

    def vjp(self, w: Array) -> Array:
        """Vector-Jacobian product Jᵀ w."""
        return np.asarray(self._there.vjp(w) + self._shifts.T @ w)

    def gradient(self, w: Array) -> Array:
        """As `vjp`, cheaper for a single product."""
        return np.asarray(self._there.gradient(w) + self._shifts.T @ w)
