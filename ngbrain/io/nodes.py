"""The quadratic (10-node) view of a tetrahedral mesh, for files and pictures of NGSolve fields."""

from __future__ import annotations

from typing import Any

import ngsolve as ng
import numpy as np
import numpy.typing as npt

from ngbrain.errors import InputError, nearest
from ngbrain.io.mesh_arrays import build_mesh, mesh_arrays

# Reference coordinates of NGSolve's tetrahedron: its vertices, then the midpoints of its edges in NGSolve's local order
# 03 13 23 01 02 12.
_NODES = [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)]
_NODES += [(0.5, 0.0, 0.0), (0.0, 0.5, 0.0), (0.0, 0.0, 0.5), (0.5, 0.5, 0.0), (0.5, 0.0, 0.5), (0.0, 0.5, 0.5)]
# VTK has vertices abcd with det(b-a, c-a, d-a) > 0 and then the midpoints ab bc ca ad bd cd. The first row takes
# abcd = 0123; the second abcd = 1023, which turns a negative tetrahedron (Netgen's usual ones are) into a positive one.
_TO_VTK = np.array([[0, 1, 2, 3, 7, 9, 8, 4, 5, 6], [1, 0, 2, 3, 7, 8, 9, 5, 4, 6]])


def _topology(mesh: ng.Mesh) -> npt.NDArray[np.int64]:
    """Numbers of the 4 vertices, 6 edges and 4 faces of every tetrahedron, (ntets, 14)."""
    rows = [[n.nr for n in (*el.vertices, *el.edges, *el.faces)] for el in mesh.Elements(ng.VOL)]
    return np.array(rows, dtype=np.int64)


class QuadraticGrid:
    """A tetrahedral mesh as quadratic (10-node) tetrahedra, numbered and oriented as in VTK.

    Node `i < mesh.nv` is vertex `i`; node `mesh.nv + e` is the midpoint of NGSolve's edge `e`, on the curved geometry if the
    mesh is curved. Build it once per run: it also holds the arrays of the mesh that every `save` writes.

    Parameters
    ----------
    mesh : ngsolve.Mesh
        Must not be refined, curved or deformed afterwards.

    Attributes
    ----------
    points : numpy.ndarray
        (n, 3) coordinates, m.
    connectivity : numpy.ndarray
        (ntets, 10) nodes in the order of VTK_QUADRATIC_TETRA, positively oriented.
    region : numpy.ndarray
        (ntets,) index into `region_names`.
    region_names : tuple of str
        Materials of the mesh.
    arrays : dict of numpy.ndarray
        Arrays that the mesh is rebuilt from (`ngbrain.io.mesh_arrays`).

    Raises
    ------
    InputError
        The mesh contains other elements than tetrahedra, is deformed, curved by polynomials of degree above 2, or was refined
        inside NGSolve: such a mesh is rebuilt with other edge numbers, which would permute every vector of unknowns.

    Examples
    --------
    >>> from netgen.occ import unit_cube
    >>> grid = QuadraticGrid(ng.Mesh(unit_cube.GenerateMesh(maxh=0.5)))
    >>> u = grid.values(ng.CF((ng.x, ng.y, ng.x * ng.z)))
    >>> bool(abs(u[:, 2] - grid.points[:, 0] * grid.points[:, 2]).max() < 1e-15)
    True
    """

    def __init__(self, mesh: ng.Mesh) -> None:
        elements = list(mesh.Elements(ng.VOL)) if mesh.dim == 3 else []
        if not elements or any(el.type != ng.ET.TET for el in elements):
            raise InputError("mesh", f"of dimension {mesh.dim} with {mesh.ne} elements", "tetrahedra, and only those")
        if mesh.deformation is not None:
            raise InputError("mesh", "deformed", "the undeformed mesh: call mesh.UnsetDeformation() first")
        topology = _topology(mesh)
        self.mesh = mesh
        self.arrays = mesh_arrays(mesh)
        if not np.array_equal(topology, _topology(build_mesh(self.arrays))):
            wanted = "one whose numbering survives a file: mesh = build_mesh(mesh_arrays(mesh)) before any space"
            raise InputError("mesh", "refined or renumbered", wanted)
        self.region_names: tuple[str, ...] = tuple(mesh.GetMaterials())
        self.region: npt.NDArray[np.int32] = np.array([el.index for el in elements], dtype=np.int32)
        # In the order of _NODES, to scatter NGSolve's values there.
        self._nodes = np.hstack([topology[:, :4], mesh.nv + topology[:, 4:10]])
        self._rule = ng.IntegrationRule(_NODES, [0.0] * len(_NODES))
        self.points: npt.NDArray[np.float64] = np.zeros((mesh.nv + mesh.nedge, 3))
        self.points[self._nodes] = self._evaluate(ng.CF((ng.x, ng.y, ng.z)))
        corners = self.points[self._nodes[:, :4]]
        negative = np.linalg.det(corners[:, 1:] - corners[:, :1]) < 0
        order = _TO_VTK[negative.astype(int)]
        self.connectivity: npt.NDArray[np.int64] = np.take_along_axis(self._nodes, order, axis=1)

    def _evaluate(self, cf: ng.CoefficientFunction) -> npt.NDArray[np.float64]:
        at = self.mesh.MapToAllElements({ng.ET.TET: self._rule}, ng.VOL)
        return np.asarray(cf(at)).reshape(len(self._nodes), len(_NODES), cf.dim)

    def values(self, cf: Any, regions: str | None = None) -> npt.NDArray[np.float64]:
        """Nodal values of a field: the mean over the adjacent tetrahedra.

        A continuous field keeps its nodal values (to round-off); a discontinuous one, such as a stress, is averaged.

        Parameters
        ----------
        cf : ngsolve.CoefficientFunction or float
            A real field.
        regions : str, optional
            NGSolve pattern of material names (`"brain|tumour"`); only their tetrahedra count. Give it for a field defined on a
            part of the mesh: the zeros elsewhere would halve the mean at the interface.

        Returns
        -------
        numpy.ndarray
            (n,) for a scalar field, else (n, dim), a tensor row by row; 0 at nodes without a counted tetrahedron.

        Raises
        ------
        InputError
            The field is complex, or no region matches.
        """
        cf = ng.CF(cf)
        if cf.is_complex:
            raise InputError("field", "complex", "a real one: take .real and .imag (or abs) apart")
        nodes, values = self._nodes, self._evaluate(cf)
        if regions is not None:
            counts = np.array(list(self.mesh.Materials(regions).Mask()), dtype=bool)[self.region]
            if not counts.any():
                raise InputError("regions", repr(regions), nearest(regions, set(self.region_names)))
            nodes, values = nodes[counts], values[counts]
        flat, n = nodes.ravel(), len(self.points)
        number = np.maximum(np.bincount(flat, minlength=n), 1)
        columns = [np.bincount(flat, column, minlength=n) / number for column in values.reshape(-1, cf.dim).T]
        return columns[0] if cf.dim == 1 else np.stack(columns, axis=1)
