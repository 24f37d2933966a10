"""Wave data on the voxels of an image and in other units of length; missing keys.

displacement   (x, y, z, components), (x, y, z, loads, components) or, normal to a slice, (x, y, 1) instead of (loads, n, d),
with
spacing        of the voxels, one number or one per axis; the first voxel is at the origin
mask, labels … (x, y, z) in this case
displacement_unit, length_unit   m, cm, mm or um: of displacement and samples; of points and spacing (m)
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ngbrain.errors import InputError, nearest

REQUIRED = ("points", "displacement", "frequency", "density", "symmetry", "rheology")
IN_VOLUMES = ("spacing", "displacement_unit", "length_unit")
"""Keys that this module reads."""
LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "μm": 1e-6}


def convert_to_metres(keys: Mapping[str, Any]) -> dict[str, Any]:
    """Convert lengths to m and drop the keys that name units. Raises `InputError` for an unknown unit.

    >>> convert_to_metres({"points": np.array([[1.0, 2.0]]), "length_unit": "mm"})["points"].tolist()
    [[0.001, 0.002]]
    """
    found = dict(keys)
    for unit, names in (("displacement_unit", ("displacement", "samples")), ("length_unit", ("points", "spacing"))):
        name = found.pop(unit, None)
        if name is None:
            continue
        name = str(np.asarray(name).item())
        if name not in LENGTHS:
            raise InputError(unit, repr(name), nearest(name, LENGTHS))
        for each in names:
            if each in found:
                found[each] = LENGTHS[name] * np.asarray(found[each])
    return found


def add_load_axis(u: np.ndarray) -> np.ndarray:
    """Values on voxels as (x, y, z, loads, components), times may follow; a missing axis of loads or components is added.

    >>> [add_load_axis(np.zeros(shape)).shape for shape in ((4, 4, 3, 3), (4, 4, 1, 7), (4, 4, 1))]
    [(4, 4, 3, 1, 3), (4, 4, 1, 7, 1), (4, 4, 1, 1, 1)]
    """
    if u.ndim == 3:
        return u[..., None, None]
    if u.ndim == 4:
        one_component = u.shape[2] == 1 and u.shape[3] != 2
        return u[..., None] if one_component else u[:, :, :, None]
    return u


def is_plane(shape: tuple[int, ...]) -> bool:
    """Whether values (x, y, z, loads, components[, times]) are plane data of one slice. `InputError` for shapes of neither kind."""
    plane = len(shape) in (5, 6) and shape[4] in (1, 2) and shape[2] == 1
    if not plane and not (len(shape) in (5, 6) and shape[4] == 3 and min(shape[:3]) > 1):
        wanted = (
            "(x, y, z, loads, 3) or (x, y, z, 3), (x, y, 1, loads, 2) in the plane or (x, y, 1, loads, 1) through it; "
            "times may follow components"
        )
        raise InputError("displacement", f"of shape {shape}", wanted)
    return plane


def voxels_to_points(keys: Mapping[str, Any]) -> dict[str, Any]:
    """Replace `spacing` by points, and flatten all values on voxels, numbered along x first."""
    found = dict(keys)
    if "spacing" not in found:
        u = np.asarray(found.get("displacement", 0))
        if "points" in found and u.ndim in (1, 2):
            n, through = len(np.asarray(found["points"])), _text(found.get("motion")) == "anti_plane"
            one_each = through and u.shape[-1] == n  # MATLAB drops the last axis where it has one component
            found["displacement"] = u.reshape(-1, n, 1) if one_each else u[None]
        return found
    name = next((each for each in ("displacement", "samples", "phase") if each in found), None)
    if "points" in found or name is None:
        raise InputError("spacing", "given" if name else "given without displacement", "points or spacing, not both")
    u = add_load_axis(np.asarray(found[name]))
    plane, shape = is_plane(u.shape), u.shape[:3]
    d, n = 2 if plane else 3, int(np.prod(shape))
    spacing = np.asarray(found.pop("spacing"), float).ravel()
    if spacing.size not in (1, d, 3) or not (np.isfinite(spacing) & (spacing > 0)).all():
        raise InputError("spacing", spacing.tolist(), f"one number or {d}, above 0")
    spacing = np.broadcast_to(spacing, (d,)) if spacing.size == 1 else spacing[:d]
    found["points"] = np.indices(shape).reshape(3, n, order="F").T[:, :d] * spacing
    found[name] = np.moveaxis(u.reshape(n, *u.shape[3:], order="F"), 1, 0)
    for other, value in found.items():
        values = np.asarray(value)
        if other not in ("points", name) and values.shape[:3] == shape:
            found[other] = values.reshape(n, *values.shape[3:], order="F")
        elif other in ("mask", "labels", "magnitude") and values.shape == shape[:2] and plane:
            found[other] = values.reshape(n, order="F")
    return found


def missing_keys(keys: Mapping[str, Any], known: tuple[str, ...] = ()) -> list[str]:
    """Names of missing keys.

    Parameters
    ----------
    keys : mapping
        Keys that are given.
    known : tuple of str, optional
        Keys that another file has.

    Returns
    -------
    list of str
    """
    required = {name: f"{name} or spacing" if name == "points" else name for name in REQUIRED}
    names = [said for name, said in required.items() if name not in keys and name not in known]
    through = _text(keys.get("motion")) == "anti_plane" and _text(keys.get("rheology")) == "viscoelastic"
    if "poisson" not in keys and "bulk" not in keys and not through:
        names.append("poisson or bulk")
    fibres = {"fibre", "fibre_angle_deg", "fibre_map"} & {*keys, *known}
    if _text(keys.get("symmetry")) == "transversely_isotropic" and not fibres:
        names.append("fibre, fibre_angle_deg or, beside an image, fibre_map")
    return names


def _text(value: Any) -> str:
    value = np.asarray("" if value is None else value)
    return str(value.item()) if value.size == 1 else ""
