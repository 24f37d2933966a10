"""Measured maps of stiffness and fibre directions, as fields over a body."""

from __future__ import annotations

import os

import ngsolve as ngs
import numpy as np

from ngbrain.errors import InputError
from ngbrain.forward.common.interpolation import quadrature_points
from ngbrain.forward.observables.percentiles import weighted_percentile
from ngbrain.image.read.fibre_directions import FibreDirections, principal_directions
from ngbrain.image.read.property_maps import fill_missing, read_map
from ngbrain.image.read.volume import Volume


def read_modulus_map(path: str | os.PathLike[str]) -> Volume:
    """Read a NIfTI map of shear moduli (Pa); voxels without a value (0 or NaN) take that of the nearest voxel with one.

    Raises `InputError` where it is unreadable, does not have three axes, has no value at all, or a negative one; `MissingExtra`
    without nibabel.
    """
    return fill_missing(read_map(path, "shear moduli (Pa)"))


def interpolate_map(volume: Volume, mesh: ngs.Mesh) -> ngs.GridFunction:
    """Interpolate a map to the vertices of a mesh.

    Parameters
    ----------
    volume : Volume
        Shear moduli (Pa).
    mesh : ngs.Mesh
        In space, or of the plane y = 0 with coordinates x and z.

    Returns
    -------
    ngs.GridFunction
        Linear between vertices (Pa).

    Raises
    ------
    InputError
        The body extends beyond the image by more than a voxel.
    """
    points = np.array([vertex.point for vertex in mesh.vertices])
    if mesh.dim == 2:
        points = np.column_stack([points[:, 0], np.zeros(len(points)), points[:, 1]])
    where, last = volume.to_voxels(points), np.array(volume.data.shape) - 1
    beyond = float(np.max(np.maximum(-where, where - last)))
    if beyond > 1.0:
        raise InputError("map", f"an image that ends {beyond:.0f} voxels inside the body", "an image of the whole body")
    field = ngs.GridFunction(ngs.H1(mesh, order=1))
    field.vec.FV().NumPy()[:] = volume.interpolate(volume.to_world(np.clip(where, 0, last)))
    return field


def fibre_field(directions: FibreDirections, mesh: ngs.Mesh, where: np.ndarray) -> ngs.CoefficientFunction:
    """Fibre direction of each element: the principal direction of the mean structure tensor of its points.

    Parameters
    ----------
    directions : FibreDirections
    mesh : ngs.Mesh
        In space.
    where : (ne,) bool array
        Elements that need a direction.

    Returns
    -------
    CoefficientFunction
        Unit vectors.

    Raises
    ------
    InputError
        Less than half of these elements lies in voxels with a direction.
    """
    space, points = quadrature_points(mesh, 2)
    rules = space.GetIntegrationRules()
    element = np.repeat(np.arange(mesh.ne), [len(rules[each.type].weights) for each in mesh.Elements()])
    directions.check_covers(points[where[element]], "tissue's points")
    tensors = np.zeros((mesh.ne, 3, 3))
    np.add.at(tensors, element, directions.tensors(points))
    parts = []
    for values in principal_directions(tensors).T:
        parts.append(ngs.GridFunction(ngs.L2(mesh, order=0)))
        parts[-1].vec.FV().NumPy()[:] = values
    return ngs.CF(tuple(parts))


def region_median(field: ngs.GridFunction, region: str) -> float:
    """Volume-weighted median of a field over a region.

    Parameters
    ----------
    field : ngs.GridFunction
    region : str

    Returns
    -------
    float
    """
    mesh = field.space.mesh
    amounts, sizes = (
        ngs.Integrate(each, mesh, definedon=mesh.Materials(region), element_wise=True).NumPy()
        for each in (field, ngs.CF(1))
    )
    own = sizes > 0
    return weighted_percentile(amounts[own] / sizes[own], sizes[own], 50)
