"""Ultrasound data of a lesion in tissue compressed by an uneven plate: a window of a block three times as large."""

from dataclasses import replace

import netgen.csg as csg
import netgen.occ as occ
import ngsolve as ngs
import numpy as np
from scipy.ndimage import gaussian_filter

from ngbrain.forward.common.interpolation import evaluation
from ngbrain.forward.harmonic.problem import HarmonicProblem
from ngbrain.forward.harmonic.wave import Wave
from ngbrain.io.waves import WaveData
from ngbrain.materials import Shearing

WINDOW, POINTS, RADIUS, CONTRAST = 0.028, 57, 4.5e-3, 3.0
BLOCK, POISSON, YOUNGS = 3 * WINDOW, 0.495, 1e4
CENTRE = np.array([WINDOW / 2, WINDOW - 0.016])  # of the lesion in the window, whose top is the block's


def plane():
    block = occ.MoveTo(-WINDOW, -2 * WINDOW).Rectangle(BLOCK, BLOCK).Face()
    lesion = occ.Circle(occ.Pnt(*CENTRE), RADIUS).Face()
    block.edges.name = "free"
    block.edges.Min(occ.Y).name, block.edges.Max(occ.Y).name = "bottom", "top"
    block.faces.name, lesion.faces.name = "soft", "stiff"
    lesion.faces.maxh = 2e-3
    made = occ.Glue([block - lesion, lesion])
    return ngs.Mesh(occ.OCCGeometry(made, dim=2).GenerateMesh(maxh=5e-3, grading=0.2)).Curve(4), "P4/P3"


def ball():
    low, high = csg.Pnt(-WINDOW, -2 * WINDOW, -BLOCK / 2), csg.Pnt(2 * WINDOW, WINDOW, BLOCK / 2)
    bottom = csg.Plane(low, csg.Vec(0, -1, 0)).bc("bottom")
    top = csg.Plane(high, csg.Vec(0, 1, 0)).bc("top")
    sphere = csg.Sphere(csg.Pnt(*CENTRE, 0), RADIUS).maxh(2.5e-3)
    sides = csg.Plane(low, csg.Vec(-1, 0, 0)) * csg.Plane(low, csg.Vec(0, 0, -1))
    sides = (sides * csg.Plane(high, csg.Vec(1, 0, 0)) * csg.Plane(high, csg.Vec(0, 0, 1))).bc("free")
    geometry = csg.CSGeometry()
    block = sides * bottom * top
    geometry.Add((block - sphere).mat("soft"))
    geometry.Add((block * sphere).mat("stiff"))
    return ngs.Mesh(geometry.GenerateMesh(maxh=12e-3, grading=0.4)).Curve(2), "P2/P1"


def compression(shape, noise=1.5e-3, grain=(0.6, 0.4), seed=0):
    """Axial displacement of the window: a frictionless plate, tilted and bent, moved by 1 % of the window.

    noise   relative to the rms; grain  widths (mm) of the Gaussians that it is smoothed by, along the beam and across; None: white
    """
    mesh, form = shape()
    across = (ngs.x - WINDOW / 2) / WINDOW
    press = -0.01 * BLOCK / 3 * (1 + 0.2 * across - 0.25 * across**2)
    shear = mesh.MaterialCF({"soft": YOUNGS, "stiff": CONTRAST * YOUNGS}) / (2 * (1 + POISSON))
    still = (0,) * mesh.dim
    held = {name: "bottom|top" if name == "y" else "bottom" for name in "xyz"[: mesh.dim]}
    drive = (0, press, 0)[: mesh.dim]
    bulk = 2 * (1 + POISSON) / (3 * (1 - 2 * POISSON)) * shear
    body = HarmonicProblem(
        mesh,
        Shearing(shear * (1 + 0j)),
        [Wave(0.0, {"bottom": still, "top": drive})],
        bulk=bulk,
        form=form,
        dirichlet=held,
    )
    (wave,) = body.solve()
    line = np.linspace(0, WINDOW, POINTS)
    points = np.array([[x, y] for y in line for x in line])
    inside = np.column_stack([points, np.zeros(len(points))])[:, : mesh.dim]
    space = ngs.H1(mesh, order=int(form[1]))
    n = space.ndof
    axial = evaluation(space, inside) @ wave.components[0].vec.FV().NumPy()[n : 2 * n].real
    rough = np.random.default_rng(seed).normal(size=(POINTS, POINTS))
    if grain is not None:
        spacing = 1e3 * WINDOW / (POINTS - 1)
        rough = gaussian_filter(rough, (grain[0] / spacing, grain[1] / spacing), mode="wrap")
    u = np.full((1, len(points), 2), np.nan)
    u[0, :, 1] = axial + noise * np.sqrt(np.mean(axial**2)) * rough.ravel() / rough.std()
    youngs = np.where(np.linalg.norm(points - CENTRE, axis=1) < RADIUS, CONTRAST, 1.0) * YOUNGS
    data = WaveData(points, u, [0.0], 1000.0, "isotropic", "elastic", poisson=POISSON, truth={"youngs": youngs})
    return replace(data, tissue="phantom")


def contrast(points, modulus, centre=CENTRE, radius=RADIUS):
    """Median of the lesion's core over that of the background 2 mm off lesion and rim; that background's IQR over its median."""
    away, low, high = np.linalg.norm(points - centre, axis=1), points.min(axis=0), points.max(axis=0)
    inner = ((points > low + 2e-3) & (points < high - 2e-3)).all(axis=1)
    around = modulus[inner & (away > radius + 2e-3)]
    quarter, half, most = np.percentile(around, [25, 50, 75])
    return np.median(modulus[away < radius - 1e-3]) / half, (most - quarter) / half
