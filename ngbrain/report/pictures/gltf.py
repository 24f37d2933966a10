"""Surfaces as binary glTF 2.0 (.glb), which viewers of augmented and virtual reality, Blender and browsers open."""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ngbrain.atomic import atomic_write
from ngbrain.errors import InputError
from ngbrain.report.pictures.panel import SurfaceLayer
from ngbrain.report.render.surface import vertex_normals

FLOAT, UINT, UBYTE = 5126, 5125, 5121
"""Component types of glTF."""
Y_UP = np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]])
"""Right, front, up of a head in glTF's axes, whose second points up and whose third points to the viewer, back."""


def write_gltf(path: str | Path, layers: Sequence[SurfaceLayer]) -> Path:
    """Write surfaces as a .glb file in m: a node for each, with its name; values become colours of the vertices.

    Right, front and up (x, y, z) become x, -z and y, since glTF's y axis points up. Colours are linear, as glTF wants them. The
    key of the colours and the factor between them and values are in `extras` of the mesh.

    Parameters
    ----------
    path : str or Path
        Output file.
    layers : sequence of SurfaceLayer
        Surfaces; those drawn as edges are left out.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    InputError
        There is no surface, or the file does not end in .glb.

    Examples
    --------
    >>> import tempfile
    >>> square = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]) / 100
    >>> layer = SurfaceLayer("plate", square, np.array([[0, 1, 2], [1, 3, 2]]))
    >>> write_gltf(tempfile.mkdtemp() + "/plate.glb", [layer]).name
    'plate.glb'
    """
    path = Path(path)
    if path.suffix != ".glb":
        raise InputError("file", path.name, "a name that ends in .glb")
    surfaces = [each for each in layers if len(each.triangles) and not each.edges]
    if not surfaces:
        raise InputError("layers", "empty", "at least one surface with triangles")
    binary = bytearray()
    views, accessors, meshes, materials = list[dict[str, Any]](), list[dict[str, Any]](), list[Any](), list[Any]()

    def add(values: np.ndarray, component: int, kind: str, **more: Any) -> int:
        views.append(
            {"buffer": 0, "byteOffset": len(binary), "byteLength": values.nbytes, "target": more.pop("target", 34962)}
        )
        binary.extend(values.tobytes())
        binary.extend(b"\0" * (-len(binary) % 4))
        accessor = {"bufferView": len(views) - 1, "componentType": component, "count": len(values), "type": kind}
        accessors.append({**accessor, **more})
        return len(accessors) - 1

    for each in surfaces:
        used, triangles = np.unique(each.triangles, return_inverse=True)
        triangles = triangles.reshape(-1, 3)
        points = np.asarray(each.points, float)[used] @ Y_UP.T
        normals = vertex_normals(points, triangles)
        normals[~normals.any(axis=1)] = [0, 1, 0]
        at = points.astype("<f4")
        attributes = {
            "POSITION": add(at, FLOAT, "VEC3", min=at.min(axis=0).tolist(), max=at.max(axis=0).tolist()),
            "NORMAL": add(normals.astype("<f4"), FLOAT, "VEC3"),
        }
        mesh: dict[str, Any] = {"name": each.name, "extras": {"unit": "m"}}
        rgb = [int(each.colour[k : k + 2], 16) / 255 for k in (1, 3, 5)]
        if each.values is not None and each.scale is not None:
            colours = each.scale.palette()[np.maximum(each.scale.bytes_of(np.asarray(each.values, float)[used]), 1)]
            linear = np.column_stack([_linear(colours[:, :3] / 255), np.ones(len(colours))])
            attributes["COLOR_0"] = add(np.rint(255 * linear).astype("u1"), UBYTE, "VEC4", normalized=True)
            mesh["extras"] |= {"values": each.scale.label, "low": each.scale.low, "high": each.scale.high}
            rgb = [1.0, 1.0, 1.0]
        indices = add(triangles.astype("<u4").ravel(), UINT, "SCALAR", target=34963)
        base = [*_linear(np.array(rgb)).tolist(), each.opacity]
        materials.append(
            {
                "name": each.name,
                "doubleSided": True,
                "alphaMode": "BLEND" if each.opacity < 1 else "OPAQUE",
                "pbrMetallicRoughness": {"baseColorFactor": base, "metallicFactor": 0.0, "roughnessFactor": 0.8},
            }
        )
        mesh["primitives"] = [{"attributes": attributes, "indices": indices, "material": len(materials) - 1}]
        meshes.append(mesh)
    scene = {
        "asset": {"version": "2.0", "generator": "ngbrain"},
        "scene": 0,
        "scenes": [{"nodes": list(range(len(meshes)))}],
        "nodes": [{"name": each["name"], "mesh": i} for i, each in enumerate(meshes)],
        "meshes": meshes,
        "materials": materials,
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(binary)}],
    }
    text = json.dumps(scene).encode()
    text += b" " * (-len(text) % 4)
    head = struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(binary))
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(binary), b"BIN\0") + bytes(binary)
    atomic_write(path, lambda part: part.write_bytes(head + chunks))
    return path


def _linear(srgb: np.ndarray) -> np.ndarray:
    """Linear colours (0 to 1) of sRGB ones."""
    return np.asarray(np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4))
