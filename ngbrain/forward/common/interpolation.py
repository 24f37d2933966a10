"""Interpolation of finite-element functions at points, as a sparse matrix: forward for data, transposed for adjoints."""

from __future__ import annotations

import ngsolve as ngs
import numpy as np
import scipy.sparse as sp
from ngsolve.comp import IntegrationRuleSpace

from ngbrain.errors import InputError


def evaluation(space: ngs.FESpace, points: np.ndarray) -> sp.csr_array:
    """Interpolation matrix from the degrees of freedom of a scalar space to values at points.

    Parameters
    ----------
    space : ngsolve.FESpace
        Scalar space.
    points : array (n, dim)
        Points (m).

    Returns
    -------
    csr_array (n, ndof)

    Raises
    ------
    InputError
        For points outside of the mesh (`points_in_mesh` finds them), or of another dimension.

    Examples
    --------
    >>> from ngbrain.mesh.geometry.structured import rectangles
    >>> mesh = rectangles(np.linspace(0, 1, 3), np.linspace(0, 1, 3))
    >>> gfu = ngs.GridFunction(ngs.H1(mesh, order=2)); gfu.Set(ngs.x * ngs.y)
    >>> at = evaluation(gfu.space, np.array([[0.25, 0.75], [1.0, 1.0]]))
    >>> (at @ gfu.vec.FV().NumPy()).round(12).tolist()
    [0.1875, 1.0]
    """
    mesh, points = space.mesh, np.asarray(points, float)
    if points.ndim != 2 or points.shape[1] != mesh.dim:
        raise InputError(
            "points", f"of shape {points.shape}", f"(n, {mesh.dim}), as the mesh has {mesh.dim} dimensions"
        )
    found = mesh(*points.T)
    if np.any(found["nr"] < 0):
        missed = int(np.sum(found["nr"] < 0))
        raise InputError("points", f"{missed} of {len(points)} outside of the mesh", "points inside of it")
    rows, columns, values = [], [], []
    order = np.argsort(found["nr"], kind="stable")
    numbers = found["nr"][order]
    for group in np.split(order, np.flatnonzero(np.diff(numbers)) + 1):
        element = ngs.ElementId(ngs.VOL, int(found["nr"][group[0]]))
        shapes, dofs = space.GetFE(element), np.array(space.GetDofNrs(element))
        for point in group:
            at = found[point]
            values.append(np.array(shapes.CalcShape(at["x"], at["y"], at["z"])))
            columns.append(dofs)
            rows.append(np.full(len(dofs), point))
    entries = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
    return sp.coo_array(entries, shape=(len(points), space.ndof)).tocsr()


def points_in_mesh(mesh: ngs.Mesh, points: np.ndarray) -> np.ndarray:
    """Mask of the points that lie in the mesh.

    Parameters
    ----------
    mesh : ngsolve.Mesh
    points : array (n, dim)
        Points (m).

    Returns
    -------
    bool array (n,)

    Examples
    --------
    >>> from ngbrain.mesh.geometry.structured import rectangles
    >>> mesh = rectangles(np.linspace(0, 1, 3), np.linspace(0, 1, 3))
    >>> points_in_mesh(mesh, np.array([[0.5, 0.5], [1.5, 0.5]])).tolist()
    [True, False]
    """
    return np.asarray(mesh(*np.asarray(points, float).T)["nr"] >= 0)


def quadrature_points(mesh: ngs.Mesh, order: int) -> tuple[IntegrationRuleSpace, np.ndarray]:
    """Space of values at quadrature points, and the points.

    Parameters
    ----------
    mesh : ngsolve.Mesh
    order : int
        Order of the quadrature.

    Returns
    -------
    space : IntegrationRuleSpace
    points : array (n, dim)
        In metres.
    """
    space = IntegrationRuleSpace(mesh, order=order)
    at, points = ngs.GridFunction(space), np.empty((space.ndof, mesh.dim))
    for i, coordinate in enumerate((ngs.x, ngs.y, ngs.z)[: mesh.dim]):
        at.Interpolate(coordinate)
        points[:, i] = at.vec.FV().NumPy()
    return space, points


def quadrature_field(space: IntegrationRuleSpace, values: np.ndarray) -> ngs.GridFunction:
    """Field from its values at quadrature points, for integrals of that order only.

    Parameters
    ----------
    space : IntegrationRuleSpace
        Of `quadrature_points`.
    values : array (n,)
        Values at the points.

    Returns
    -------
    GridFunction

    Examples
    --------
    >>> from ngbrain.mesh.geometry.structured import rectangles
    >>> mesh = rectangles(np.linspace(0, 1, 3), np.linspace(0, 1, 3))
    >>> space, points = quadrature_points(mesh, 2)
    >>> rule = ngs.dx(intrules=space.GetIntegrationRules())
    >>> round(float(ngs.Integrate(quadrature_field(space, points[:, 0]) * rule, mesh)), 12)
    0.5
    """
    found = ngs.GridFunction(space)
    found.vec.FV().NumPy()[:] = values
    return found
