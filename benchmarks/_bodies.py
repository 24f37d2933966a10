"""Bodies of eight models under two loads or three, simulated in triangles of fifth order and sampled on a grid, truth known."""

from __future__ import annotations

from functools import lru_cache

import netgen.occ as occ
import ngsolve as ngs
import numpy as np

from ngbrain.forward import HarmonicProblem, Wave, evaluation
from ngbrain.io import WaveData
from ngbrain.materials import Shearing, SmallStrainLaw, TransverselyIsotropic

SIDE = 0.08
BULK = {"compressible": 2e4, "nearly incompressible": 1e7}


def bump(x, y, exp=np.exp):  # type: ignore[no-untyped-def]
    """A stiff inclusion at the centre."""
    return exp(-((x - SIDE / 2) ** 2 + (y - SIDE / 2) ** 2) / 3e-4)


def fibre_angle(x):  # type: ignore[no-untyped-def]
    """Fibres turn by 45° across the body."""
    return 0.5 + 10 * (x - SIDE / 2)


@lru_cache
def waves(
    symmetry: str = "isotropic", rheology: str = "viscoelastic", volume: str = "compressible", n: int = 25
) -> WaveData:
    """Two loads (three with fibres) at the top, all else free; G' from 5 to 7.5 kPa, loss tangent .15."""
    square = occ.Rectangle(SIDE, SIDE).Face()
    square.edges.Max(occ.Y).name = "top"
    mesh = ngs.Mesh(occ.OCCGeometry(square, dim=2).GenerateMesh(maxh=SIDE / 8))
    bulk, mixed = BULK[volume], volume != "compressible"
    lossy = 1 + (0.15j if rheology == "viscoelastic" else 0j)
    stiff = (5e3 + 2.5e3 * bump(ngs.x, ngs.y, ngs.exp)) * lossy
    law: SmallStrainLaw = Shearing(stiff)
    if symmetry != "isotropic":
        angle = fibre_angle(ngs.x)
        fibre = ngs.CF((ngs.cos(angle), ngs.sin(angle)))
        law = TransverselyIsotropic(stiff, 0.5 + bump(ngs.x, ngs.y, ngs.exp), ngs.CF(0.3), fibre)
    loads = [Wave(50.0, {"top": (1e-5, 0)}), Wave(60.0, {"top": (0, 1e-5)})]
    loads += [Wave(40.0, {"top": (1e-5, 1e-5)})] if symmetry != "isotropic" else []
    body = HarmonicProblem(mesh, law, loads, bulk=bulk, form="P5/P4" if mixed else "P5", dirichlet="top")
    line = np.linspace(0, SIDE, n)
    points = np.column_stack([part.ravel() for part in np.meshgrid(line, line)])
    there = bump(*points.T)
    shear = (5e3 + 2.5e3 * there) * lossy
    truth = {"shear": shear} if symmetry == "isotropic" else {"mu": shear, "zeta": 0.5 + there, "phi": 0.3 + 0 * there}
    angle = fibre_angle(points[:, 0])
    return WaveData(
        points,
        sampled(body, points),
        [wave.frequency for wave in loads],
        1000.0,
        symmetry,
        rheology,
        bulk=bulk,
        fibre=None if symmetry == "isotropic" else np.column_stack([np.cos(angle), np.sin(angle)]),
        truth=truth,
    )


def sampled(body: HarmonicProblem, points: np.ndarray) -> np.ndarray:
    """Waves (loads, n, 2) at points."""
    at = evaluation(ngs.H1(body.mesh, order=body.form.order), points)
    waves = [(u.components[0] if body.mixed else u).vec.FV().NumPy() for u in body.solve()]
    return np.array([(at @ values[: 2 * at.shape[1]].reshape(2, -1).T) for values in waves])
