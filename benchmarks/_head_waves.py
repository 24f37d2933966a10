"""Simulated waves in the MNI152 head, the data of `elastography_head`."""

from __future__ import annotations

from dataclasses import dataclass

import netgen.csg as csg
import ngsolve as ngs
import numpy as np

from ngbrain.forward import (
    HarmonicProblem,
    Wave,
    common,
    evaluation,
    harmonic,
    points_in_mesh,
    quadrature_field,
    quadrature_points,
)
from ngbrain.image import LabelMap, label_tissues, mni152
from ngbrain.inverse import StiffnessMap, data, read_stiffness
from ngbrain.io import WaveData, load_or_compute
from ngbrain.materials import Shearing
from ngbrain.mesh import RadialSizeField, mesh_elements

Array = np.ndarray
NAMES = ("grey", "white", "inclusion", "fluid")
MODULI = np.array([2.0e3 + 0.8e3j, 2.7e3 + 1.2e3j, 5.4e3 + 2.4e3j, 0.3e3 + 0.3e3j])
"""G* (Pa) at 50 Hz, of the magnitude reported by MR elastography at 50 to 80 Hz; the inclusion has twice that of white matter."""
BULK = 2e5
"""Known bulk modulus (Pa): about a hundred times the shear moduli; tissue has a million times."""
CENTRE, RADIUS = np.array([0.028, -0.012, 0.022]), 7.5e-3
FREQUENCY, DENSITY = 50.0, 1000.0
HINGE = (0.0, -0.02, -0.07)
NODDING, SIDEWAYS = 2e-4, 15e-6
"""Rotation (rad) about the left-right axis through HINGE, translation (m) along it."""
EDGE = 60e-3
"""Edge (m) of the cube around the ball that is simulated with a measured map."""
STIFFER, DETAIL, VOXEL, SEED = 2.0, 0.15, 2e-3, 0
"""Factors on a measured map: this one in the ball, and in every voxel of 2 mm the exponential of a normal number with
this standard deviation, as a mean of 134 people is smooth and a person is not."""


@dataclass(frozen=True, eq=False)
class Head:
    """Tissue of the brain with a stiff ball in it; moduli of a measured map, or `MODULI` where there is none."""

    labels: LabelMap
    measured: StiffnessMap | None = None

    def modulus_at(self, x: Array) -> Array:
        """G* (Pa) at points (n, 3) m; ventricles have that of the fluid."""
        label = self.label_at(x)
        if self.measured is None:
            return MODULI[label]
        modulus = self.smooth_at(x) * np.exp(DETAIL * _normal(np.rint(x / VOXEL).astype(int)))
        return np.where(label == 3, MODULI[3], np.where(label == 2, STIFFER, 1) * modulus)

    def smooth_at(self, x: Array) -> Array:
        """The measured map itself (Pa)."""
        assert self.measured is not None
        return self.measured.interpolate(x)

    def label_at(self, x: Array) -> Array:
        """Index (n,) in `NAMES` of points (n, 3) m: neither white nor ventricle counts as grey."""
        tissue = self._tissue(x)
        number = np.select([tissue == "white", tissue == "ventricles"], [1, 3], 0)
        return np.where(np.linalg.norm(x - CENTRE, axis=1) < RADIUS, 2, number)

    def parenchyma(self, x: Array) -> Array:
        """Mask of the points (n, 3) m in grey matter, white matter or the ball."""
        near = np.linalg.norm(x - CENTRE, axis=1) < RADIUS
        return near | np.isin(self._tissue(x), ("grey", "white"))

    def _tissue(self, x: Array) -> Array:
        volume = self.labels.volume
        at = np.rint(volume.to_voxels(x)).astype(int)
        within = ((at >= 0) & (at < volume.data.shape)).all(axis=1)
        number = np.where(within, volume.data[tuple(np.clip(at, 0, np.array(volume.data.shape) - 1).T)], 0)
        table = np.array(["outside", *(self.labels.names.get(i, "") for i in range(1, int(volume.data.max()) + 1))])
        return table[number]


def waves_of_head(size: float, form: str, spacing: float, maps: tuple[str, str] | None = None) -> WaveData:
    """Noise-free waves at voxels of the parenchyma; simulated on tetrahedra of `size` (m).

    Two loads: the skull nods, and it moves sideways. Ventricles are filled with a fluid that is soft and lossy.

    maps    files of stiffness and damping ratio in the space of MNI152, which the moduli are then taken from, in a cube around the
            ball, whose whole boundary is shaken as the skull is
    """
    subject = head(maps)

    def make() -> dict[str, Array]:
        mesh, degree = (
            _cube(size) if maps else mesh_elements(subject.labels, "hull", RadialSizeField(size, size)).mesh(),
            int(form[1]) + 1,
        )
        space, at = quadrature_points(mesh, degree)
        modulus = subject.modulus_at(at)
        nod = (0, -NODDING * (ngs.z - HINGE[2]), NODDING * (ngs.y - HINGE[1]))
        loads = [Wave(FREQUENCY, {"skull": nod}), Wave(FREQUENCY, {"skull": (SIDEWAYS, 0, 0)})]
        law = Shearing(quadrature_field(space, modulus.real) + 1j * quadrature_field(space, modulus.imag))
        body = HarmonicProblem(
            mesh, law, loads, bulk=BULK, density=DENSITY, form=form, dirichlet="skull", quadrature=degree
        )
        x = _voxels(subject, mesh, spacing)
        observe = evaluation(ngs.H1(mesh, order=body.form.order), x)
        u = [(observe @ gfu.vec.FV().NumPy().reshape(3, -1).T) for gfu in body.solve()]
        return {"points": x, "displacement": np.array(u)}

    body_of = [list(map(str, MODULI)), BULK, DENSITY, CENTRE.tolist(), RADIUS]
    if subject.measured:
        volumes = (subject.measured.stiffness, subject.measured.damping_ratio)
        body_of += [*(volume.digest() for volume in volumes), STIFFER, DETAIL, VOXEL, SEED, EDGE]
    made_from = [subject.labels.volume.digest(), size, form, spacing, body_of, FREQUENCY, HINGE, NODDING, SIDEWAYS]
    made = load_or_compute("head-waves", made_from, (harmonic.problem, common.interpolation, data.stiffness_maps), make)
    return _on_grid(subject, made["points"], made["displacement"], spacing)


def _cube(size: float) -> ngs.Mesh:
    geometry = csg.CSGeometry()
    geometry.Add(csg.OrthoBrick(csg.Pnt(*(CENTRE - EDGE / 2)), csg.Pnt(*(CENTRE + EDGE / 2))).bc("skull"))
    return ngs.Mesh(geometry.GenerateMesh(maxh=size))


def head(maps: tuple[str, str] | None = None) -> Head:
    """The MNI152 brain, with the moduli of two files if given."""
    return Head(label_tissues(mni152()).labels, read_stiffness(*maps) if maps else None)


def _normal(voxel: Array) -> Array:
    """A normal number for each voxel (n, 3), reproducible for each voxel."""
    box = np.random.default_rng(SEED).standard_normal((256, 256, 256))
    return box[tuple((voxel % 256).T)]


def _voxels(subject: Head, mesh: ngs.Mesh, spacing: float) -> Array:
    """Centres (n, 3) m of the voxels in the parenchyma and in the mesh."""
    corners = np.array([v.point for v in mesh.vertices])
    first, last = np.floor(corners.min(axis=0) / spacing), np.ceil(corners.max(axis=0) / spacing)
    lines = [np.arange(a, b + 1) for a, b in zip(first, last, strict=True)]
    x = spacing * np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 3)
    x = x[subject.parenchyma(x)]
    return np.asarray(x[points_in_mesh(mesh, x)])


def _on_grid(subject: Head, points: Array, displacement: Array, spacing: float) -> WaveData:
    """The data on the bounding box of voxels, with the points as mask."""
    low = points.min(axis=0)
    index = np.rint((points - low) / spacing).astype(int)
    shape = index.max(axis=0) + 1
    lines = [a + spacing * np.arange(n) for a, n in zip(low, shape, strict=True)]
    grid = np.stack(np.meshgrid(*lines[::-1], indexing="ij"), axis=-1).reshape(-1, 3)[:, ::-1]
    here = np.ravel_multi_index(index.T[::-1], shape[::-1])
    u, mask = np.full((len(displacement), len(grid), 3), np.nan + 0j), np.zeros(len(grid), bool)
    u[:, here], mask[here] = displacement, True
    labels = np.where(mask, subject.label_at(grid), 0)
    return WaveData(
        grid,
        u,
        [FREQUENCY] * len(u),
        DENSITY,
        "isotropic",
        "viscoelastic",
        bulk=BULK,
        mask=mask,
        labels=labels,
        truth={"shear": subject.modulus_at(grid)},
    )
