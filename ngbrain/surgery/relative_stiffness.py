"""Measured maps of shear moduli in a retraction, as relative maps: the ratio to each tissue's mean scales that tissue's
moduli.

Elastography measures at small strain and tens of hertz, where brain is several times as stiff as in a retraction of minutes. The
ratio between one place and another is what carries over.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import ngsolve as ngs
import numpy as np

from ngbrain.errors import file_context
from ngbrain.forward.common.interpolation import quadrature_field, quadrature_points
from ngbrain.image.read.property_maps import interpolate_map, measured_mask
from ngbrain.image.read.volume import Volume

Mixtures = Mapping[str, Mapping[str, Any]]
"""Region of the mesh → tissue → its volume fraction at the quadrature points."""


def stiffness_ratio_fields(
    volume: Volume, mesh: ngs.Mesh, mixtures: Mixtures, order: int
) -> dict[str, ngs.GridFunction]:
    """Ratio of a map to its mean over each tissue, as a field at quadrature points.

    Points without a measurement take the value of the nearest measured voxel.

    Parameters
    ----------
    volume : Volume
        Map of shear moduli.
    mesh : ngs.Mesh
    mixtures : mapping
        Tissue fractions of the regions that count (`Mixtures`).
    order : int
        Order of the integration rule; the fields are valid for this rule only.

    Returns
    -------
    dict of ngs.GridFunction
        By tissue.

    Raises
    ------
    InputError
        The map has no values over most of these regions.
    """
    space, _ = quadrature_points(mesh, order)
    return {
        name: quadrature_field(space, ratio)
        for name, (ratio, *_) in _ratio_at_points(volume, mesh, mixtures, order).items()
    }


def mean_modulus(volume: Volume, mesh: ngs.Mesh, mixtures: Mixtures, order: int) -> float:
    """Volume-weighted mean of a map over all given tissues.

    Parameters
    ----------
    volume : Volume
    mesh : ngs.Mesh
    mixtures : mapping
        Tissue fractions (`Mixtures`).
    order : int
        Order of the integration rule.

    Returns
    -------
    float
        In the unit of the map.
    """
    over = _ratio_at_points(volume, mesh, mixtures, order).values()
    amounts = [(values @ weight, weight.sum()) for _, weight, _, values in over]
    return float(sum(amount for amount, _ in amounts) / sum(size for _, size in amounts))


def summary(volume: Volume, mesh: ngs.Mesh, mixtures: Mixtures, order: int) -> dict[str, dict[str, float]]:
    """Spread of the stiffness ratio within each tissue, and the fraction that was not measured.

    Parameters
    ----------
    volume : Volume
    mesh : ngs.Mesh
    mixtures : mapping
        Tissue fractions (`Mixtures`).
    order : int
        Order of the integration rule.

    Returns
    -------
    dict
        Tissue → `ratio_p5`, `ratio_p95` (5th and 95th percentile by volume) and `not_measured` (fraction of the volume).
    """
    found = {}
    for name, (ratio, weight, known, _) in _ratio_at_points(volume, mesh, mixtures, order).items():
        order_of = np.argsort(ratio)
        share = np.cumsum(weight[order_of]) / weight.sum()
        p5, p95 = (float(ratio[order_of][np.searchsorted(share, each)]) for each in (0.05, 0.95))
        found[name] = {"ratio_p5": p5, "ratio_p95": p95, "not_measured": float(weight[~known].sum() / weight.sum())}
    return found


def _ratio_at_points(
    volume: Volume, mesh: ngs.Mesh, mixtures: Mixtures, order: int
) -> dict[str, tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]]:
    """Tissue → ratio, volume (m³, 0 outside the tissue), whether it was measured, and map value at every quadrature point."""
    space, points = quadrature_points(mesh, order)
    one = ngs.GridFunction(space)
    amount = ngs.LinearForm(space)  # its entries are the points' volumes
    amount += space.TestFunction() * ngs.dx(intrules=space.GetIntegrationRules())
    amount.Assemble()
    volumes = amount.vec.FV().NumPy()
    weights = dict[str, np.ndarray]()
    for region, shares in mixtures.items():
        inside = mesh.MaterialCF({region: 1.0}, default=0.0)
        for name, share in shares.items():
            one.Interpolate(inside * share)
            weights[name] = weights.get(name, 0.0) + volumes * one.vec.FV().NumPy()
    counted = np.sum(list(weights.values()), axis=0) > 0
    known = np.ones(len(points), bool)
    with file_context("body.shear_modulus_map"):
        known[counted] = measured_mask(volume, points[counted])
    values = interpolate_map(volume, points)
    return {
        name: (values / (values @ weight / weight.sum()), weight, known, values)
        for name, weight in weights.items()
        if weight.any()
    }


def summary_lines(found: Mapping[str, Mapping[str, float]]) -> list[str]:
    """A `summary` as one line for the result's warnings; empty without tissues."""
    each = [
        f"{name} {of['ratio_p5']:.2f} to {of['ratio_p95']:.2f} times its mean (5th to 95th percentile), "
        f"{of['not_measured']:.0%} not measured and taken from the nearest voxel that was"
        for name, of in found.items()
    ]
    return [f"moduli follow the shear-modulus map: {'; '.join(each)}"] if each else []
