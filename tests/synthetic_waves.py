"""Wave data with a known truth, computed on triangles of high order and sampled on a grid, without an inverse crime."""

from __future__ import annotations

import sys
from pathlib import Path

import netgen.occ as occ
import ngsolve as ngs
import numpy as np

sys.path.append(str(Path(__file__).parents[1] / "benchmarks"))

from _bodies import sampled, waves

from ngbrain.forward.harmonic.problem import HarmonicProblem
from ngbrain.forward.harmonic.wave import Wave
from ngbrain.io.waves import WaveData
from ngbrain.materials import Shearing

__all__ = ["pressed", "sampled", "waves"]


def pressed(poisson: float = 0.49, bulk: float | None = None, tilted: bool = False, n: int = 25) -> WaveData:
    """Strain imaging: a square of 4 cm at rest between glued plates, one comes 0.4 mm closer, or (second load) closer to the right
    only; G from 5 to 12.5 kPa in a spot above the middle.
    """
    side = 0.04
    square = occ.Rectangle(side, side).Face()
    square.edges.Max(occ.Y).name, square.edges.Min(occ.Y).name = "top", "bottom"
    mesh = ngs.Mesh(occ.OCCGeometry(square, dim=2).GenerateMesh(maxh=side / 8))

    def stiffness(x, y, exp):  # type: ignore[no-untyped-def]
        return 5e3 + 7.5e3 * exp(-((x - 0.02) ** 2 + (y - 0.022) ** 2) / 5e-5)

    shear = stiffness(ngs.x, ngs.y, ngs.exp)
    squeezed = 2 * (1 + poisson) / (3 * (1 - 2 * poisson)) * shear if bulk is None else bulk
    loads = [Wave(0.0, {"top": (0, -4e-4)}), Wave(0.0, {"top": (0, -4e-4 * ngs.x / side)})][: 1 + tilted]
    body = HarmonicProblem(mesh, Shearing(shear * (1 + 0j)), loads, bulk=squeezed, form="P5/P4", dirichlet="top|bottom")
    points = np.column_stack([part.ravel() for part in np.meshgrid(*[np.linspace(0, side, n)] * 2)])
    return WaveData(
        points,
        sampled(body, points),
        [0.0] * len(loads),
        1000.0,
        "isotropic",
        "elastic",
        poisson=poisson if bulk is None else None,
        bulk=bulk,
        truth={"shear": stiffness(*points.T, np.exp)},
    )
