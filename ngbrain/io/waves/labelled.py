"""Wave data and property maps as data sets of xarray: on a grid along its axes, else along `point`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ngbrain.io.labelled_arrays import AXES, Variable, dataset

if TYPE_CHECKING:
    from ngbrain.io.waves.data import WaveData

POINT = "point"
MAPS = {
    "youngs": ("Pa", "Young's modulus"),
    "shear": ("Pa", "complex shear modulus G*"),
    "storage": ("Pa", "storage modulus G′"),
    "loss": ("Pa", "loss modulus G″"),
    "magnitude": ("Pa", "magnitude |G*| of the complex shear modulus"),
    "phase": ("rad", "loss angle arg G*"),
    "damping_ratio": ("1", "damping ratio G″/2G′"),
    "stiffness": ("Pa", "shear stiffness ρc² of a plane shear wave"),
    "mu": ("Pa", "shear modulus μ across the fibres"),
    "zeta": ("1", "tensile anisotropy ζ of fibres"),
    "phi": ("1", "shear anisotropy φ of fibres"),
    "shear_along": ("Pa", "shear modulus μ(1 + φ) along the fibres"),
    "shear_stretch": ("Pa", "shear modulus μ(1 + ζ) of stretched fibres"),
    "exponent": ("1", "exponent of the frequency in G*"),
}
"""Map → unit and words."""


def map_variables(maps: Mapping[str, np.ndarray]) -> dict[str, Variable]:
    """Variables of property maps (n,) by name."""
    return {name: ((POINT,), values, *MAPS.get(name, ("", name))) for name, values in maps.items()}


def wave_variables(data: WaveData) -> dict[str, Variable]:
    """Variables of wave data: displacement, mask, labels, and the true properties."""
    found: dict[str, Variable] = {
        "displacement": (("load", POINT, "component"), data.displacement, "m", "complex amplitude of the displacement"),
        "mask": ((POINT,), data.mask, "1", "points that are used"),
    }
    if data.labels is not None:
        found["label"] = ((POINT,), data.labels, "1", "number of the region")
    truth = map_variables(dict(data.truth))
    return found | {
        f"true_{name}": (dims, values, units, f"true {said}") for name, (dims, values, units, said) in truth.items()
    }


def wave_dataset(data: WaveData, variables: Mapping[str, Variable]) -> Any:
    """Variables at the points of wave data as a data set.

    Parameters
    ----------
    data : WaveData
        The points, loads and components.
    variables : mapping
        Name → axes (`point` among them), values, unit and words.

    Returns
    -------
    xarray.Dataset
        Points on a grid that is aligned with the coordinates are along x, y, z (m); others along `point`.

    Raises
    ------
    MissingExtra
        xarray is not installed.
    """
    grid, found = data.grid, dict(variables)
    places: dict[str, Variable] = {}
    if grid is not None and grid.is_axis_aligned:
        axes = AXES[: data.dim]
        for i, axis in enumerate(axes):
            places[axis] = ((axis,), grid.origin[i] + grid.spacing[i] * np.arange(grid.shape[i]), "m", axis)
        for name, (dims, values, units, said) in variables.items():
            at = dims.index(POINT)
            rest = dims[:at] + dims[at + 1 :]
            found[name] = ((*axes, *rest), grid.box(np.moveaxis(np.asarray(values), at, 0)), units, said)
    else:
        places = {axis: ((POINT,), data.points[:, i], "m", axis) for i, axis in enumerate(AXES[: data.dim])}
    used = {dim for dims, *_ in found.values() for dim in dims}
    if "load" in used:
        places["frequency"] = (("load",), data.frequency, "Hz", "frequency of the load")
    if "component" in used:
        places["component"] = (("component",), np.array(list(data.components)), "1", "component of the displacement")
    facts = {name: getattr(data, name) for name in ("density", "symmetry", "rheology", "poisson", "tissue", "motion")}
    return dataset(found, places, {name: value for name, value in facts.items() if value is not None})
