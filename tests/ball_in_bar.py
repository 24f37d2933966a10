"""Waves in a bar with a stiff ball at its centre, computed with fourth order on tetrahedra, at points with 2 % noise."""

import ngsolve as ngs
import numpy as np
from netgen.csg import CSGeometry, OrthoBrick, Pnt

from ngbrain.forward.common.interpolation import evaluation
from ngbrain.forward.harmonic.problem import HarmonicProblem
from ngbrain.forward.harmonic.wave import Wave
from ngbrain.inverse.problem.label_shares import combine_labels, label_shares
from ngbrain.io.waves import WaveData
from ngbrain.materials import Shearing

SIDES, RADIUS = (0.06, 0.035, 0.035), 0.012
SOFT, STIFF = 4000.0 + 1600.0j, 8000.0 + 3200.0j
HERTZ, SPACING = 80.0, 2.5e-3
WAVES = [
    Wave(HERTZ, {"all": (0, 1e-5 * ngs.x / SIDES[0], 1e-5)}),
    Wave(HERTZ, {"all": (1e-5, 0, 1e-5 * ngs.y / SIDES[1])}),
]


def away(points):
    """Distance from the ball's centre (m)."""
    return np.linalg.norm(points - np.array(SIDES) / 2, axis=1)


def wave_data():
    geometry = CSGeometry()
    geometry.Add(OrthoBrick(Pnt(0, 0, 0), Pnt(*SIDES)).bc("all"))
    mesh = ngs.Mesh(geometry.GenerateMesh(maxh=0.009))
    at = label_shares(mesh, 5, lambda x: (away(x) < RADIUS).astype(int), ["soft", "stiff"])
    parts = [
        combine_labels(at, {"soft": ngs.CF(getattr(SOFT, k)), "stiff": ngs.CF(getattr(STIFF, k))})
        for k in ("real", "imag")
    ]
    made = HarmonicProblem(
        mesh, Shearing(parts[0] + 1j * parts[1]), WAVES, bulk=2e5, form="P4", dirichlet="all", quadrature=5
    )
    lines = [np.arange(SPACING / 2, side, SPACING) for side in SIDES]
    points = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 3, order="F")
    observe = evaluation(ngs.H1(mesh, order=4), points)
    n = observe.shape[1]
    u = [np.column_stack([observe @ v.vec.FV().NumPy()[i * n : (i + 1) * n] for i in range(3)]) for v in made.solve()]
    labels = (away(points) < RADIUS).astype(int)
    truth = {"shear": np.array([SOFT, STIFF])[labels]}
    kind = ("isotropic", "viscoelastic")
    return WaveData(points, np.array(u), [HERTZ] * 2, 1000.0, *kind, bulk=2e5, labels=labels, truth=truth).with_noise(
        0.02, 5
    )
