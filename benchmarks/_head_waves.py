"""Waves in the head of the MNI152 brain, made up: what `elastography_head` inverts."""

from __future__ import annotations

from dataclasses import dataclass, replace

import ngsolve as ngs
import numpy as np

from ngbrain.forward import harmonic, points
from ngbrain.forward.harmonic import Harmonic, Wave
from ngbrain.forward.points import evaluation, inside
from ngbrain.image import mni152
from ngbrain.image.labelfile import TISSUES
from ngbrain.image.labelmap import LabelMap
from ngbrain.image.tissues import tissues
from ngbrain.inverse import labels as inverse_labels
from ngbrain.inverse.labels import by_label, shares
from ngbrain.io.cache import kept
from ngbrain.materials import Shearing
from ngbrain.mesh.elements import Elements
from ngbrain.mesh.grading import Graded
from ngbrain.mesh.routes import meshed

Array = np.ndarray
MODULI = {"grey": 2.0e3 + 0.8e3j, "white": 2.7e3 + 1.2e3j, "inclusion": 5.4e3 + 2.4e3j}
"""G* (Pa) at 50 Hz: of the size that magnetic resonance elastography reports at 50 to 80 Hz; the inclusion twice white."""
BULK = 2e5
"""Pa, known: about a hundred times the shear moduli, where tissue has a million times."""
CENTRE, RADIUS = np.array([0.028, -0.012, 0.022]), 7.5e-3
FREQUENCY, DENSITY, VOXEL = 50.0, 1000.0, 2e-3
HINGE = (0.0, -0.02, -0.07)
NODDING, SIDEWAYS = 2e-4, 15e-6
"""rad about the left-right axis through HINGE, m along it."""


@dataclass(frozen=True, eq=False)
class Head:
    """Labels on voxels, and where the tissue is measured.

    names      what `label_at` numbers
    """

    labels: LabelMap
    names: tuple[str, ...] = ("grey", "white", "inclusion")

    def label_at(self, x: Array) -> Array:
        """Numbers (n,) of points (n, 3) m: the inclusion's inside its ball; fluid and what is outside count as grey."""
        number = np.where(self._tissue(x) == "white", 1, 0)
        return np.where(np.linalg.norm(x - CENTRE, axis=1) < RADIUS, 2, number)

    def parenchyma(self, x: Array) -> Array:
        """Which points (n, 3) m are grey or white matter or the inclusion."""
        near = np.linalg.norm(x - CENTRE, axis=1) < RADIUS
        return near | np.isin(self._tissue(x), ("grey", "white"))

    def _tissue(self, x: Array) -> Array:
        volume = self.labels.volume
        at = np.rint(volume.to_voxels(x)).astype(int)
        within = ((at >= 0) & (at < volume.data.shape)).all(axis=1)
        number = np.where(within, volume.data[tuple(np.clip(at, 0, np.array(volume.data.shape) - 1).T)], 0)
        table = np.array(["outside", *(self.labels.names.get(i, "") for i in range(1, int(volume.data.max()) + 1))])
        return table[number]

    def mesh(self, size: float) -> ngs.Mesh:
        """Elements of `size` (m) of all but the ventricles; boundaries `skull` and `ventricle_wall`."""
        return solid(meshed(self.labels, "hull", Graded(size, size))).mesh()


def head() -> Head:
    """The MNI152 brain, segmented."""
    return Head(LabelMap(tissues(mni152()), TISSUES))


def solid(made: Elements) -> Elements:
    """Without the ventricles."""
    tets = made.tets[made.region == made.regions.index("brain")]
    used = np.unique(tets)
    number = np.full(len(made.points), -1)
    number[used] = np.arange(len(used))
    return replace(
        made,
        points=made.points[used],
        tets=number[tets].astype(np.int32),
        region=np.zeros(len(tets), np.int32),
        triangles=number[made.triangles].astype(np.int32),
        regions=("brain",),
    )


def waves() -> list[Wave]:
    """Both driving directions, as displacements of the skull."""
    nod = (0, -NODDING * (ngs.z - HINGE[2]), NODDING * (ngs.y - HINGE[1]))
    return [Wave(FREQUENCY, {"skull": nod}), Wave(FREQUENCY, {"skull": (SIDEWAYS, 0, 0)})]


def body(mesh: ngs.Mesh, modulus: ngs.CoefficientFunction, form: str, degree: int) -> Harmonic:
    """Held at the skull; the walls of the ventricles are free."""
    return Harmonic(
        mesh, Shearing(modulus), waves(), bulk=BULK, density=DENSITY, form=form, held="skull", quadrature=degree
    )


def simulated(subject: Head, size: float, form: str) -> dict[str, Array]:
    """`points` (n, 3) m of the voxels of the parenchyma and `displacement` (2, n, 3) m there, without noise."""

    def make() -> dict[str, Array]:
        mesh, degree = subject.mesh(size), int(form[1]) + 1
        at = shares(mesh, degree, subject.label_at, subject.names)
        storage = by_label(at, {name: ngs.CF(MODULI[name].real) for name in at})
        loss = by_label(at, {name: ngs.CF(MODULI[name].imag) for name in at})
        made = body(mesh, storage + 1j * loss, form, degree)
        x = voxels(subject, mesh)
        observe = evaluation(ngs.H1(mesh, order=made.form.order), x)
        width = observe.shape[1]
        u = [
            np.column_stack([observe @ v.vec.FV().NumPy()[i * width : (i + 1) * width] for i in range(3)])
            for v in made.solve()
        ]
        return {"points": x, "displacement": np.array(u), "unknowns": np.array(made.fes.ndof)}

    made_from = [
        subject.labels.volume.digest(),
        size,
        form,
        VOXEL,
        list(map(str, MODULI.values())),
        BULK,
        CENTRE.tolist(),
        RADIUS,
    ]
    return kept("head-waves", made_from, (harmonic, points, inverse_labels), make)


def voxels(subject: Head, mesh: ngs.Mesh) -> Array:
    """Middles (n, 3) m of the voxels of `VOXEL` in the parenchyma and in the mesh."""
    corners = np.array([v.point for v in mesh.vertices])
    low, high = np.floor(corners.min(axis=0) / VOXEL).astype(int), np.ceil(corners.max(axis=0) / VOXEL).astype(int)
    index = np.stack(
        np.meshgrid(*(np.arange(a, b + 1) for a, b in zip(low, high, strict=True)), indexing="ij"), axis=-1
    )
    x = VOXEL * index.reshape(-1, 3)
    x = x[subject.parenchyma(x)]
    return np.asarray(x[inside(mesh, x)])
