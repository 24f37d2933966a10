"""Waves of a block with a stiff ball, simulated on tetrahedra that are independent of the elements of the inversion."""

from __future__ import annotations

from dataclasses import dataclass

import ngsolve as ngs
import numpy as np
from netgen.csg import CSGeometry, OrthoBrick, Pnt

from ngbrain.forward import HarmonicProblem, Wave, evaluation
from ngbrain.inverse import Discretisation, combine_labels, label_shares
from ngbrain.io import WaveData
from ngbrain.materials import Shearing
from ngbrain.mesh import boxes

Array = np.ndarray
BULK = 2e5


@dataclass(frozen=True)
class BallInBlock:
    """A cube of `side` (m) with a ball at `centre`, moduli (Pa, complex) of block and ball; driven on all its faces in two ways.

    element  size (m) of the tetrahedra that simulate it
    """

    side: float
    centre: tuple[float, float, float]
    radius: float
    moduli: tuple[complex, complex]
    hertz: float
    element: float

    def waves(self, order: int, spacing: float, noise: float) -> WaveData:
        """Noisy displacements at points `spacing` (m) apart, simulated with elements of `order`."""
        geometry = CSGeometry()
        geometry.Add(OrthoBrick(Pnt(0, 0, 0), Pnt(*(self.side,) * 3)).bc("all"))
        mesh = ngs.Mesh(geometry.GenerateMesh(maxh=self.element))
        parts = label_shares(mesh, order + 2, self.label, ["block", "ball"])
        modulus = combine_labels(
            parts, {name: ngs.CF(1) * g for name, g in zip(("block", "ball"), self.moduli, strict=True)}
        )
        drives = [(1e-5 * ngs.z / self.side, 0, 0), (0, 1e-5 * (1 - ngs.x / self.side), 0.5e-5 * ngs.y / self.side)]
        loads = [Wave(self.hertz, {"all": drive}) for drive in drives]
        body = HarmonicProblem(
            mesh, Shearing(modulus), loads, bulk=BULK, form=f"P{order}", dirichlet="all", quadrature=order + 2
        )
        line = np.linspace(0, self.side, round(self.side / spacing) + 1)
        points = np.array([[x, y, z] for z in line for y in line for x in line])
        observe = evaluation(ngs.H1(mesh, order=order), np.clip(points, 1e-9, self.side - 1e-9))
        u = [observe @ gfu.vec.FV().NumPy().reshape(3, -1).T for gfu in body.solve()]
        label = self.label(points)
        truth = {"shear": np.array(self.moduli)[label]}
        data = WaveData(
            points, u, [self.hertz] * 2, 1000.0, "isotropic", "viscoelastic", bulk=BULK, labels=label, truth=truth
        )
        return data.with_noise(noise, seed=0)

    def hexahedra(self, order: int, cells: int, points: int) -> Discretisation:
        """Hexahedra along a side for the inversion of waves at a number of points."""
        line = np.linspace(0, self.side, cells + 1)
        mesh = boxes(np.ones((cells,) * 3, bool), line, line, line)
        return Discretisation(mesh, f"P{order}", (order + 1) // 2, None, np.ones(points, bool))

    def label(self, x: Array) -> Array:
        """Indicator of the ball at points (n, 3)."""
        return (self.away(x) < self.radius).astype(int)

    def away(self, x: Array) -> Array:
        """Distance from the ball's centre (m)."""
        return np.asarray(np.linalg.norm(x - np.array(self.centre), axis=1))

    def contrast(self, points: Array, values: Array, known: Array | bool = True) -> float:
        """Median of the ball's core, 2 mm off its border, over that of the 5 mm around it."""
        away = self.away(points)
        core, around = away < self.radius - 2e-3, (away > self.radius) & (away < self.radius + 5e-3)
        return float(np.median(values[core & known]) / np.median(values[around & known]))
