"""A tetrahedral mesh as plain arrays, from which the same mesh is rebuilt; no pickles."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import combinations

import netgen.meshing as meshing
import ngsolve as ng
import numpy as np

from ngbrain.errors import InputError

Arrays = dict[str, np.ndarray]

_TETRAHEDRON, _TRIANGLE = list(combinations(range(4), 2)), [(1, 2), (0, 2), (0, 1)]
"""Netgen's order of midside nodes, as pairs of corners."""
_MIDDLES = [(0.5, 0.0, 0.0), (0.0, 0.5, 0.0), (0.0, 0.0, 0.5), (0.5, 0.5, 0.0), (0.5, 0.0, 0.5), (0.0, 0.5, 0.5)]
"""Reference coordinates of the edge midpoints of a tetrahedron, in NGSolve's order."""


def mesh_arrays(mesh: ng.Mesh) -> Arrays:
    """Arrays that define a tetrahedral mesh.

    Parameters
    ----------
    mesh : ngsolve.Mesh
        Straight, or curved by polynomials of degree 2.

    Returns
    -------
    dict of numpy.ndarray
        points (n, 3) in m; tetrahedra (m, 4 or 10) and triangles (k, 3 or 6), counted from 0, in Netgen's node order; region
        (m,) and face (k,), counted from 1; regions, the names of the regions; faces (f, 4): surface number, regions inside and
        outside, and boundary number; face_names.

    Raises
    ------
    InputError
        The mesh is curved by polynomials of higher degree, which edge nodes cannot represent.
    """
    if mesh.GetCurveOrder() > 2:
        wanted = "one that is straight or curved by polynomials of degree 2, as with mesh.Curve(2)"
        raise InputError("mesh", f"curved by polynomials of degree {mesh.GetCurveOrder()}", wanted)
    raw = mesh.ngmesh
    points, solid, flat = raw.Coordinates().copy(), raw.Elements3D().NumPy(), raw.Elements2D().NumPy()
    tetrahedra, triangles = solid["nodes"] - 1, flat["nodes"] - 1
    if mesh.GetCurveOrder() == 2:
        points, tetrahedra, triangles = _quadratic(mesh, points[: mesh.nv], tetrahedra[:, :4], triangles[:, :3])
    faces = raw.FaceDescriptors()
    return {
        "points": points,
        "tetrahedra": tetrahedra.astype(np.int32),
        "region": solid["index"].astype(np.int32),
        "triangles": triangles.astype(np.int32).reshape(
            -1, triangles.shape[1] or (3 if tetrahedra.shape[1] == 4 else 6)
        ),
        "face": flat["index"].astype(np.int32),
        "regions": _text(mesh.GetMaterials()),
        "faces": np.array([(f.surfnr, f.domin, f.domout, f.bc) for f in faces], np.int32).reshape(-1, 4),
        "face_names": _text(f.bcname for f in faces),
    }


def build_mesh(arrays: Mapping[str, np.ndarray]) -> ng.Mesh:
    """Rebuild the mesh of `mesh_arrays`, with the same points and numbering.

    Raises
    ------
    InputError
        The arrays do not define a mesh.
    """
    points, tetrahedra, triangles, region, face, faces = (
        _check_array(arrays, name, kind, columns)
        for name, kind, columns in (
            ("points", "f", (3,)),
            ("tetrahedra", "i", (4, 10)),
            ("triangles", "i", (3, 6)),
            ("region", "i", ()),
            ("face", "i", ()),
            ("faces", "i", (4,)),
        )
    )
    regions, face_names = _read_names(arrays, "regions"), _read_names(arrays, "face_names")
    sound = {
        "points": bool(len(points)) and bool(np.isfinite(points).all()),
        "tetrahedra": bool(len(tetrahedra)) and _in_range(tetrahedra, 0, len(points) - 1),
        "triangles": _in_range(triangles, 0, len(points) - 1)
        and (triangles.shape[1] == 6) == (tetrahedra.shape[1] == 10),
        "region": len(region) == len(tetrahedra) and _in_range(region, 1, len(regions)),
        "face": len(face) == len(triangles) and _in_range(face, 1, len(faces)),
        "faces": len(faces) == len(face_names)
        and _in_range(faces[:, 1:3], 0, len(regions))
        and _in_range(faces[:, 3], 1, len(faces)),
    }
    if wrong := [name for name, good in sound.items() if not good]:
        raise InputError(f"mesh.{wrong[0]}", "out of range", "those of a mesh of tetrahedra")
    mesh = meshing.Mesh(dim=3)
    mesh.AddPoints(np.ascontiguousarray(points, float))
    for number, name in enumerate(regions, 1):
        mesh.SetMaterial(number, name)
    mesh.AddElements(3, 1, np.ascontiguousarray(tetrahedra, np.int32), base=0)
    mesh.Elements3D().NumPy()["index"] = region  # the mesh's own memory
    for (surface, within, without, number), name in zip(faces.tolist(), face_names, strict=True):
        mesh.Add(meshing.FaceDescriptor(surfnr=surface, domin=within, domout=without, bc=number))
        mesh.SetBCName(number - 1, name)
    if len(triangles):
        mesh.AddElements(2, 1, np.ascontiguousarray(triangles, np.int32), base=0)
        mesh.Elements2D().NumPy()["index"] = face
    return ng.Mesh(mesh)


def _quadratic(
    mesh: ng.Mesh, corners: np.ndarray, tetrahedra: np.ndarray, triangles: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points with edge midpoints appended to the corners, and elements with midside nodes."""
    edges = np.array([[n.nr for n in element.edges] for element in mesh.Elements(ng.VOL)])
    rule = ng.IntegrationRule(_MIDDLES, [0.0] * len(_MIDDLES))
    middles = np.zeros((mesh.nedge, 3))
    middles[edges] = np.asarray(ng.CF((ng.x, ng.y, ng.z))(mesh.MapToAllElements({ng.ET.TET: rule}, ng.VOL))).reshape(
        -1, len(_MIDDLES), 3
    )
    numbers = {tuple(sorted(v.nr for v in edge.vertices)): len(corners) + edge.nr for edge in mesh.edges}

    def with_middles(elements: np.ndarray, pairs: list[tuple[int, int]]) -> np.ndarray:
        rows = [[numbers[tuple(sorted((row[i], row[j])))] for i, j in pairs] for row in elements.tolist()]
        return np.hstack([elements, np.array(rows, int).reshape(-1, len(pairs))])

    return np.vstack([corners, middles]), with_middles(tetrahedra, _TETRAHEDRON), with_middles(triangles, _TRIANGLE)


def _check_array(arrays: Mapping[str, np.ndarray], name: str, kind: str, columns: tuple[int, ...]) -> np.ndarray:
    array = np.asarray(arrays[name])
    if array.dtype.kind != kind or array.ndim != (2 if columns else 1) or (columns and array.shape[1] not in columns):
        raise InputError(f"mesh.{name}", f"{array.dtype} of shape {array.shape}", "that of a mesh of tetrahedra")
    return array


def _in_range(numbers: np.ndarray, least: int, most: int) -> bool:
    return not numbers.size or (int(numbers.min()) >= least and int(numbers.max()) <= most)


def _text(names: Iterable[str]) -> np.ndarray:
    """Names as UTF-8 bytes, one line each."""
    return np.frombuffer("".join(f"{name}\n" for name in names).encode(), np.uint8)


def _read_names(arrays: Mapping[str, np.ndarray], name: str) -> list[str]:
    try:
        return np.asarray(arrays[name], np.uint8).tobytes().decode().split("\n")[:-1]
    except UnicodeDecodeError as error:
        raise InputError(f"mesh.{name}", "not UTF-8", "names, one a line") from error
