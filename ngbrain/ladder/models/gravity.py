"""Gravity and the fluid around a body, as loads of a problem."""

from __future__ import annotations

import math
from collections.abc import Sequence

import ngsolve as ngs
import numpy as np
from ngsolve.comp import IntegrationRuleSpace

from ngbrain.errors import InputError
from ngbrain.forward.common.loads import BodyForce, FluidPressure, Load
from ngbrain.ladder.quantities import mesh_components
from ngbrain.materials.base import Value
from ngbrain.scene import Scene


def gravity_loads(scene: Scene, mesh: ngs.Mesh, density: ngs.CoefficientFunction) -> list[Load]:
    """Loads of a scene's gravity and fluid: the difference to those in which the body was imaged.

    Parameters
    ----------
    scene : Scene
    mesh : ngs.Mesh
        In space, or the section y = 0.
    density : CoefficientFunction
        Mass over volume at rest (kg/m³).

    Returns
    -------
    list of Load

    Raises
    ------
    InputError
        A fluid that is drained to a height at which there is no body.
    """
    gravity, fluid, plane = scene.gravity, scene.fluid, mesh.dim == 2
    if gravity is None:
        return []
    now = mesh_components(gravity.acceleration, plane)
    before = mesh_components(gravity.imaged or (0.0, 0.0, 0.0), plane)
    change = tuple(a - b for a, b in zip(now, before, strict=True))
    loads: list[Load] = [BodyForce(density * ngs.CF(change))] if any(change) else []
    if fluid is None:
        return loads
    low, high = _heights(mesh, now)
    level = high if fluid.drained_to is None else fluid.drained_to
    if not low <= level <= high:
        wanted = f"a height within the body, from {1e3 * low:.4g} to {1e3 * high:.4g} mm against gravity"
        raise InputError("fluid.drained_to_mm", f"{1e3 * level:.4g}", wanted)
    loads.append(FluidPressure(now, level, fluid.drained_to is not None, fluid.density))
    if any(before):
        loads.append(FluidPressure(before, _heights(mesh, before)[1], drained=False, density=-fluid.density))
    return loads


def _heights(mesh: ngs.Mesh, acceleration: Sequence[float]) -> tuple[float, float]:
    """Lowest and highest coordinate (m) of a body against gravity."""
    up = -np.array(acceleration) / math.hypot(*acceleration)
    heights = np.array([vertex.point for vertex in mesh.vertices]) @ up
    return float(heights.min()), float(heights.max())


def mean_value(mesh: ngs.Mesh, order: int, shares: Sequence[tuple[Value, float]]) -> Value:
    """Sum of fractions times numbers, averaged over elements where fractions are fields at quadrature points.

    Parameters
    ----------
    mesh : ngs.Mesh
    order : int
        Half the order of the quadrature.
    shares : sequence of (fraction, number)

    Returns
    -------
    float or CoefficientFunction

    Examples
    --------
    >>> from ngbrain.mesh import block
    >>> mean_value(block(maxh=0.05), 1, [(0.25, 4.0), (0.75, 8.0)])
    7.0
    """
    total = sum(share * number for share, number in shares)
    if not isinstance(total, ngs.CoefficientFunction):
        return total
    if len({number for _, number in shares}) == 1:
        return shares[0][1]
    over = ngs.dx(intrules=IntegrationRuleSpace(mesh, order=order).GetIntegrationRules())
    field = ngs.GridFunction(ngs.L2(mesh, order=0))
    parts = [np.array(ngs.Integrate(value * over, mesh, element_wise=True)) for value in (total, ngs.CF(1.0))]
    field.vec.FV().NumPy()[:] = parts[0] / parts[1]
    return field
