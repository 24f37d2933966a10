"""Rigid motions that no support prevents, found from supports and mesh before anything is assembled."""

from __future__ import annotations

from collections.abc import Sequence

import ngsolve as ngs
import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ngbrain.errors import InputError
from ngbrain.forward.common.dirichlet import Supports
from ngbrain.forward.common.kinematics import Axisymmetric, SolidKinematics
from ngbrain.forward.common.loads import (
    BodyForce,
    CavityPressure,
    CavityVolume,
    FluidPressure,
    Load,
    PressureLoad,
    TractionLoad,
)

NO_HOLD = (CavityPressure, CavityVolume, PressureLoad, TractionLoad, BodyForce, FluidPressure)
"""Loads that cannot prevent a rigid motion (a fluid not before it is applied in full); any other load may."""
ALMOST = 1e-6
"""Singular value, for unit motions, below which a motion counts as free."""


def check_held(supports: Supports, loads: Sequence[Load], kinematics: SolidKinematics, axes: str = "xyz") -> None:
    """Check that supports prevent all rigid motions.

    Parameters
    ----------
    supports : Supports
        Dirichlet conditions, with their mesh.
    loads : sequence of Load
        Loads; if one of them may support the body, nothing is refused.
    kinematics : SolidKinematics
        Kinematics of the mesh.
    axes : str
        Names of the axes in messages.

    Raises
    ------
    InputError
        For free rigid motions; the message names all of them, or the unsupported region.
    """
    if not all(isinstance(load, NO_HOLD) for load in loads) or isinstance(kinematics, Axisymmetric):
        return
    mesh = supports.mesh
    points = np.array([vertex.point for vertex in mesh.vertices])
    parts, materials = _components(mesh)
    fixed = _held(supports)
    for part in range(parts.max() + 1):
        motions = _free(points, fixed & (parts == part)[:, None], parts == part, axes)
        if not motions:
            continue
        where = "" if parts.max() == 0 else f"; region {' and '.join(materials[part])} is not supported"
        raise InputError(
            "supports",
            f"insufficient against {', '.join(motions)}{where}",
            "supports that prevent all rigid motions of the body",
        )


def _components(mesh: ngs.Mesh) -> tuple[np.ndarray, list[list[str]]]:
    """Connected part of each vertex, by number, and the materials of each part."""
    elements = [(element.mat, [vertex.nr for vertex in element.vertices]) for element in mesh.Elements(ngs.VOL)]
    pairs = np.array([(vertices[0], other) for _, vertices in elements for other in vertices[1:]])
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(mesh.nv, mesh.nv))
    count, parts = connected_components(graph, directed=False)
    materials = [set[str]() for _ in range(count)]
    for material, vertices in elements:
        materials[parts[vertices[0]]].add(material)
    used = [i for i, names in enumerate(materials) if names]  # the others belong to no element
    numbers = np.full(count, -1)
    numbers[used] = np.arange(len(used))
    return numbers[parts], [sorted(materials[i]) for i in used]


def _held(supports: Supports) -> np.ndarray:
    """Constrained components of each vertex (nv, dim)."""
    mesh = supports.mesh
    found = np.zeros((mesh.nv, mesh.dim), bool)
    for pattern, components in supports.components.items():
        vertices = {vertex.nr for element in mesh.Boundaries(pattern).Elements() for vertex in element.vertices}
        found[np.ix_(sorted(vertices), components)] = True
    return found


def _free(points: np.ndarray, fixed: np.ndarray, mine: np.ndarray, axes: str) -> list[str]:
    """Names of the rigid motions of some points that no constraint prevents."""
    middle = points[mine].mean(axis=0)
    x = (points - middle) / max(float(np.abs(points[mine] - middle).max()), 1e-300)
    dim = points.shape[1]
    turns = [(0, 1)] if dim == 2 else [(1, 2), (2, 0), (0, 1)]
    modes = np.zeros((len(points), dim, dim + len(turns)))
    modes[:, range(dim), range(dim)] = 1
    for k, (i, j) in enumerate(turns, start=dim):
        modes[:, i, k], modes[:, j, k] = -x[:, j], x[:, i]
    rows = modes[fixed]
    _, values, ways = np.linalg.svd(rows.T @ rows / max(len(rows), 1))
    free = ways[values < ALMOST**2 * max(1.0, values[0])] if len(rows) else ways
    if not len(free):
        return []
    along = [i for i in range(dim) if np.linalg.norm(free[:, i]) > 1 - 1e-6]
    names = [f"translation along {axes[i]}" for i in along]
    # Remaining ones: oblique motions, named by their rotation or, without one, by their translation.
    rest = free - free[:, along] @ np.eye(dim + len(turns))[along]
    left = np.linalg.svd(rest)[2][: len(free) - len(along)]
    _, sizes, spins = np.linalg.svd(left[:, dim:], full_matrices=True)
    count = int(np.sum(sizes > 1e-6))
    if dim == 2:
        names += ["rotation"] * min(count, 1)
    else:
        names += _about(spins[:count], axes)
    if extra := len(left) - count:
        names.append("an oblique translation" if extra == 1 else f"{extra} oblique translations")
    return names


def _about(spins: np.ndarray, axes: str) -> list[str]:
    """Names of rotations by their axes; coordinate axes where these span the rotations."""
    own = [i for i in range(3) if len(spins) and np.linalg.norm(spins[:, i]) > 1 - 1e-6]
    names = [f"rotation about {axes[i]}" for i in own]
    if len(own) == len(spins) - 1:
        rest = spins - spins[:, own] @ np.eye(3)[own]
        way = np.linalg.svd(rest)[2][0]
        way = way * np.sign(way[np.abs(way).argmax()]) + 0.0
        names.append(f"rotation about ({', '.join(f'{c:.2g}' for c in way)})")
    elif len(own) < len(spins):
        names.append("rotations about two oblique axes")
    return names
