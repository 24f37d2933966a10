"""Small bodies in which waves run, of all kinds, every modulus a field: models whose derivatives are looked at."""

import ngsolve as ngs
import numpy as np
from waves import cube, square

from ngbrain.forward.common.kinematics import Axisymmetric
from ngbrain.forward.harmonic.problem import HarmonicProblem
from ngbrain.forward.harmonic.wave import AbsorbingBoundary, Wave
from ngbrain.forward.sensitivity.harmonic.wave_model import WaveModel
from ngbrain.materials import Shearing, TransverselyIsotropic
from ngbrain.mesh.geometry.structured import rectangles

SIDE = 0.04
WAVES = [Wave(60.0, {"top": (1e-3, 5e-4j)}), Wave(60.0, {"bottom": (0, 1e-3)}), Wave(90.0, {"top": (1e-3, 0)})]
START = {"storage": 2000.0, "loss": 700.0, "mu": 2000.0, "zeta": 0.8, "phi": 0.5, "bulk": 9e3, "density": 1000.0}


def field(mesh, name, space=None):
    """A field that varies, around its usual value."""
    made = ngs.GridFunction(space or ngs.H1(mesh, order=1))
    made.Set(START[name] * (1 + 0.2 * ngs.sin(70 * ngs.x) * ngs.cos(50 * ngs.y)))
    return made


def model(kind="viscoelastic", form="P2", mesh=None, waves=WAVES, order=1, **options):
    """A WaveModel all of whose moduli are fields, of an order."""
    mesh = mesh or square(3, SIDE)
    names = {
        "elastic": ["storage"],
        "viscoelastic": ["storage", "loss"],
        "fibres": ["mu", "zeta", "phi"],
        "lossy fibres": ["storage", "loss", "zeta", "phi"],
        "bulk": ["storage", "bulk"],
        "density": ["storage", "density"],
    }[kind]
    fields = {name: field(mesh, name, ngs.H1(mesh, order=order)) for name in names}
    shear = fields.get("mu") or fields["storage"] * (1 if kind == "elastic" else 1 + 0.3j)
    if "loss" in fields:
        shear = fields["storage"] + 1j * fields["loss"]
    law = Shearing(shear)
    if "zeta" in fields:
        a = (ngs.cos(30 * ngs.x), ngs.sin(30 * ngs.x), 0.3)
        three = mesh.dim == 3 or options.get("kinematics")
        law = TransverselyIsotropic(shear, fields["zeta"], fields["phi"], ngs.CF(a if three else a[:2]))
    body = HarmonicProblem(
        mesh,
        law,
        waves,
        bulk=fields.get("bulk", 9e3 if "/" not in form else 2e5),
        density=fields.get("density", 1000.0),
        form=form,
        dirichlet=options.pop("dirichlet", "bottom|top"),
        **options,
    )
    inner = np.array([[0.21, 0.3, 0.4], [0.7, 0.22, 0.3], [0.4, 0.81, 0.6], [0.63, 0.57, 0.2]]) * SIDE
    return WaveModel(body, fields, inner[:, : mesh.dim])


def directions(of, rng):
    """One for each block, of the block's size."""
    theta = of.theta
    for name, block in of.blocks.items():
        direction = np.zeros(of.size)
        direction[block] = rng.normal(size=block.stop - block.start) * np.abs(theta[block]).max()
        yield name, direction


def wanted(of, rng):
    shape = (len(of.body.waves), len(of.points), of.dim)
    return 1e-3 * (rng.normal(size=shape) + 1j * rng.normal(size=shape))


MODELS = {
    "elastic": lambda: model("elastic"),
    "viscoelastic": lambda: model(),
    "fibres": lambda: model("fibres"),
    "lossy fibres": lambda: model("lossy fibres"),
    "bulk": lambda: model("bulk"),
    "density": lambda: model("density"),
    "mixed": lambda: model(form="P3/P2"),
    "fields of fourth order": lambda: model(order=4),
    "mixed, fields of fourth order": lambda: model(form="P3/P2", order=4),
    "mixed elastic": lambda: model("elastic", "P2/P1"),
    "mixed elastic fibres": lambda: model("fibres", "P2/P1"),
    "mixed fibres": lambda: model("lossy fibres", "P2/P1"),
    "mixed bulk": lambda: model("bulk", "P2/P1"),
    "grid": lambda: model(form="Q1/L2(0)", quadrature=1, mesh=rectangles(*[np.linspace(0, SIDE, 5)] * 2)),
    "revolution": lambda: model("lossy fibres", kinematics=Axisymmetric()),
    "absorbing": lambda: model(absorbing=[AbsorbingBoundary("left", 2000 + 700j, 1e4)]),
    "space": lambda: model(
        "lossy fibres", "P2/P1", cube(1, SIDE), [Wave(60.0, {"top": (1e-3, 0, 0)})], dirichlet="bottom|top"
    ),
}
