"""Waves in a block with a stiff ball, computed with third order on tetrahedra, at points with 2 % noise."""

from dataclasses import replace
from functools import cache

import ngsolve as ngs
import numpy as np
from netgen.csg import CSGeometry, OrthoBrick, Pnt

from ngbrain.forward.common.interpolation import evaluation
from ngbrain.forward.harmonic.problem import HarmonicProblem
from ngbrain.forward.harmonic.wave import Wave
from ngbrain.inverse.problem.label_shares import combine_labels, label_shares
from ngbrain.io.waves import WaveData
from ngbrain.materials import Shearing

SIDE, MIDDLE, RADIUS = 0.04, 0.02, 0.012
SOFT, STIFF = 4000.0 + 1600.0j, 8000.0 + 3200.0j
WAVES = [
    Wave(50.0, {"all": (0, 1e-5 * ngs.x / SIDE, 1e-5)}),
    Wave(50.0, {"all": (1e-5, 0, 1e-5 * ngs.y / SIDE)}),
]


def cube(size):
    geometry = CSGeometry()
    geometry.Add(OrthoBrick(Pnt(0, 0, 0), Pnt(SIDE, SIDE, SIDE)).bc("all"))
    return ngs.Mesh(geometry.GenerateMesh(maxh=size))


def label_at(x):
    return (np.linalg.norm(x - MIDDLE, axis=1) < RADIUS).astype(int)


def body(mesh, law, form="P3", degree=3):
    return HarmonicProblem(mesh, law, WAVES, bulk=2e5, form=form, dirichlet="all", quadrature=degree)


@cache
def measured():
    """Points, noisy displacements and the standard deviation of their real and imaginary parts."""
    mesh = cube(0.0101)
    at = label_shares(mesh, 4, label_at, ["soft", "stiff"])
    parts = [
        combine_labels(at, {"soft": ngs.CF(a), "stiff": ngs.CF(b)})
        for a, b in zip(*map(_parts, (SOFT, STIFF)), strict=True)
    ]
    made = body(mesh, Shearing(parts[0] + 1j * parts[1]), "P3", 4)
    line = np.arange(1e-3, SIDE, 3e-3)
    x = np.stack(np.meshgrid(line, line, line, indexing="ij"), axis=-1).reshape(-1, 3)
    observe = evaluation(ngs.H1(mesh, order=3), x)
    n = observe.shape[1]
    u = [np.column_stack([observe @ v.vec.FV().NumPy()[i * n : (i + 1) * n] for i in range(3)]) for v in made.solve()]
    random = np.random.default_rng(5)
    deviation = 0.02 * np.sqrt((np.abs(u) ** 2).mean(axis=1, keepdims=True) / 2)
    return x, u + deviation * (random.normal(size=(2, *x.shape)) + 1j * random.normal(size=(2, *x.shape))), deviation


def _parts(value):
    return value.real, value.imag


def wave_data():
    """The same as data that `invert` takes, with labels: 0 soft, 1 stiff; points along x first."""
    x, u, _ = measured()
    n = round(len(x) ** (1 / 3))
    order = np.arange(len(x)).reshape(n, n, n).transpose(2, 1, 0).ravel()
    label, modulus = label_at(x[order]), np.array([SOFT, STIFF])
    return WaveData(
        x[order],
        u[:, order],
        [50.0, 50.0],
        1000.0,
        "isotropic",
        "viscoelastic",
        bulk=2e5,
        noise=0.02,
        labels=label,
        truth={"shear": modulus[label]},
    )


def between(low, high):
    """The points in a box (m)."""
    data = wave_data()
    inside = np.all((data.points > np.array(low) - 1e-6) & (data.points < np.array(high) + 1e-6), axis=1)
    return replace(
        data,
        points=data.points[inside],
        displacement=data.displacement[:, inside],
        labels=data.labels[inside],
        truth={"shear": data.truth["shear"][inside]},
        mask=None,
        dirichlet=None,
    )
