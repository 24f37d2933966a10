"""Published maps of shear stiffness and damping ratio as complex shear moduli of a head: the truth of in-silico experiments.

`ngbrain.datasets.write("mre134")` writes those of 134 adults. `ngbrain.inverse.elastography.derived_maps.maps_from_shear` is
the inverse.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from pathlib import Path

import ngsolve as ngs
import numpy as np

from ngbrain.errors import InputError, file_context
from ngbrain.forward.common.interpolation import quadrature_field, quadrature_points
from ngbrain.image.read.property_maps import interpolate_map, measured_mask, read_map
from ngbrain.image.read.volume import Volume
from ngbrain.look import BriefText
from ngbrain.materials.modulus import modulus_from_stiffness

UNITS = {"Pa": 1.0, "kPa": 1e3}
STIFFNESS = (300.0, 30e3)
"""Range (Pa) for soft tissue at the frequencies of elastography. Its values in kPa and in Pa do not overlap."""
DAMPING_RATIO = (0.005, 1.5)


@dataclass(frozen=True, eq=False, repr=False)
class StiffnessMap(BriefText):
    """Maps of a head's stiffness and damping on the same voxels.

    Parameters
    ----------
    stiffness : Volume
        Shear stiffness μ = 2|G*|²/(G' + |G*|), Pa; NaN where nothing was measured.
    damping_ratio : Volume
        ξ = G''/2G', NaN there too.
    note : str
        The assumed unit, and what was left out, in a sentence.
    """

    stiffness: Volume
    damping_ratio: Volume
    note: str

    @property
    def modulus(self) -> np.ndarray:
        """G* (Pa) of every voxel, complex, NaN where nothing was measured."""
        return modulus_from_stiffness(self.stiffness.data, self.damping_ratio.data)

    def interpolate(self, points: np.ndarray) -> np.ndarray:
        """Interpolate G* to points.

        Parameters
        ----------
        points : numpy.ndarray
            (n, 3) m. Between voxels stiffness and damping ratio are linear. Where nothing was measured, the nearest measured
            voxel counts.

        Returns
        -------
        numpy.ndarray
            (n,) complex, Pa.

        Raises
        ------
        InputError
            More than half of the points lie where nothing was measured: another space, or another unit of length.
        """
        measured_mask(self.stiffness, points)
        return modulus_from_stiffness(
            interpolate_map(self.stiffness, points), interpolate_map(self.damping_ratio, points)
        )

    def quadrature_fields(self, mesh: ngs.Mesh, degree: int) -> tuple[ngs.GridFunction, ngs.GridFunction]:
        """Interpolate G' and G'' to the quadrature points of a mesh.

        Parameters
        ----------
        mesh : ngsolve.Mesh
            Mesh in m.
        degree : int
            `quadrature` of the `HarmonicProblem` that uses them. They are valid in its integrals only.

        Returns
        -------
        storage, loss : ngsolve.GridFunction
            G' and G'', Pa.

        Raises
        ------
        InputError
            As `interpolate`.
        """
        space, points = quadrature_points(mesh, degree)
        modulus = self.interpolate(points)
        return quadrature_field(space, modulus.real), quadrature_field(space, modulus.imag)

    def transform(self, affine: np.ndarray) -> StiffnessMap:
        """Return the maps in another head.

        Parameters
        ----------
        affine : numpy.ndarray
            (4, 4), takes points (m) of the maps' space to points of the head: for a T1,
            `ngbrain.image.labelling.template_affine`.

        Returns
        -------
        StiffnessMap
            The moved maps.
        """
        stiffness, damping = (Volume(each.data, affine @ each.affine) for each in (self.stiffness, self.damping_ratio))
        return replace(self, stiffness=stiffness, damping_ratio=damping)


def read_stiffness(
    stiffness: str | os.PathLike[str], damping_ratio: str | os.PathLike[str], unit: str | None = None
) -> StiffnessMap:
    """Read maps of shear stiffness and damping ratio, as MRE134 publishes them.

    Parameters
    ----------
    stiffness, damping_ratio : path
        NIfTI or MGH, also each in a ZIP archive of its own; 0 or NaN where nothing was measured.
    unit : str, optional
        Of the stiffness, Pa or kPa. By default it follows from the size of the values, and the note says so.

    Returns
    -------
    StiffnessMap
        In the space of the files. Stiffness below 300 Pa counts as not measured: it is the rim of a map that was averaged or
        interpolated with the zeros around it.

    Raises
    ------
    InputError
        A file is unreadable; the values are none of tissue in the unit; the two files are swapped, or not on the same voxels.
    MissingExtra
        nibabel is not installed.

    Examples
    --------
    >>> read_stiffness("stiffness.nii.zip", "damping.nii.zip", "MPa")
    Traceback (most recent call last):
    ngbrain.errors.InputError: unit is 'MPa'; wanted: Pa or kPa
    """
    if unit is not None and unit not in UNITS:
        raise InputError("unit", repr(unit), "Pa or kPa")
    ratio = read_map(damping_ratio, "damping ratios")
    with file_context(Path(damping_ratio)):
        middle = float(np.nanmedian(ratio.data))
        if not DAMPING_RATIO[0] <= middle <= DAMPING_RATIO[1]:
            wanted = "ratios, {:g} to {:g} in tissue: are stiffness and damping ratio swapped?".format(*DAMPING_RATIO)
            raise InputError("damping_ratio", f"{middle:.4g} in the median", wanted)
    mu = read_map(stiffness, "shear stiffness")
    with file_context(Path(stiffness)):
        if mu.data.shape != ratio.data.shape or not np.allclose(mu.affine, ratio.affine, atol=1e-6):
            raise InputError("stiffness", f"on other voxels than {damping_ratio}", "two maps on the same voxels")
        middle = float(np.nanmedian(mu.data))
        given, unit = unit, unit or _unit(middle)
        low, high = STIFFNESS
        if unit is None or not low <= UNITS[unit] * middle <= high:
            wanted = f"{low:g} to {high:g} Pa, or {low / 1e3:g} to {high / 1e3:g} kPa, as of soft tissue"
            raise InputError("stiffness", f"{middle:.4g} {unit or ''} in the median".replace("  ", " "), wanted)
    pascals = UNITS[unit] * mu.data
    bare = ~np.isnan(pascals) & ~(pascals >= low)
    unknown = np.isnan(ratio.data) | ~(pascals >= low)
    left, right = (Volume(np.where(unknown, np.nan, each), mu.affine) for each in (pascals, ratio.data))
    said = (
        f"stiffness is in {unit}" if given else f"stiffness is taken for {unit} by its size, {middle:.4g} in the median"
    )
    if bare.any():
        share = bare.sum() / (~np.isnan(pascals)).sum()
        said += f"; {share:.2%} of the voxels, below {low:g} Pa, count as not measured"
    return StiffnessMap(left, right, said)


def _unit(middle: float) -> str | None:
    """The unit in which a median is one of soft tissue, None if there is none."""
    return next((unit for unit, size in UNITS.items() if STIFFNESS[0] <= size * middle <= STIFFNESS[1]), None)
