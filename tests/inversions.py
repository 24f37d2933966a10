"""Inverse problems with one or two unknowns, and their optimisers."""

import ngsolve as ngs
import numpy as np
import scipy.sparse as sp

from ngbrain.adjoint.reduced import Reduced
from ngbrain.forward.harmonic.problem import HarmonicProblem
from ngbrain.forward.harmonic.wave import Wave
from ngbrain.forward.sensitivity.harmonic.wave_model import WaveModel
from ngbrain.inverse.objective.misfit import LeastSquares
from ngbrain.inverse.objective.parameters import LogTransform, ParameterFields, Unknown
from ngbrain.inverse.objective.regularisation import ridge, smooth
from ngbrain.materials import Shearing
from ngbrain.mesh.geometry.structured import rectangles

MODULUS, FREQUENCY, SIDE = 9e3, 50.0, 0.12
"""Shear waves of 60 mm in a square of twice that."""


def square(nodes, form, loss=0.0, bulk_over_shear=None, held="top|bottom"):
    """A model of a uniform square, its top sheared; its fields are storage, and bulk if the ratio is given."""
    line = np.linspace(0, SIDE, nodes)
    mesh = rectangles(line, line)
    space = ngs.H1(mesh, order=1)
    fields = {"storage": ngs.GridFunction(space)}
    fields["storage"].vec[:] = MODULUS
    shear = fields["storage"] * (1 + 2j * loss)
    bulk = 13 / 6 * shear
    if bulk_over_shear is not None:
        fields["bulk"] = bulk = ngs.GridFunction(space)
        bulk.vec[:] = bulk_over_shear * MODULUS
    wave = Wave(FREQUENCY, {"top": (1e-3, 0)} if held == "top|bottom" else {})
    body = HarmonicProblem(mesh, Shearing(shear), [wave], bulk=bulk, form=form, dirichlet=held)
    return WaveModel(body, fields, np.array([v.point for v in mesh.vertices]))


def scatter(data, noise, seed=0):
    """Standard deviation of what is added to each part, and the sum."""
    sigma = noise * np.sqrt(np.mean(np.abs(data) ** 2, axis=1, keepdims=True)) / np.sqrt(2)
    return sigma, data + sigma * (np.random.default_rng(seed).normal(size=(*data.shape, 2)) @ [1, 1j])


def one_modulus(loss, start, nodes=17):
    """ln of the modulus of the whole square, with all edges prescribed as measured with 1 % noise; J, and waves to start from."""
    true = square(nodes, "Q1", loss)
    sigma, measured = scatter(true.evaluate(true.theta).data, 0.01)
    model = square(nodes, "Q1", loss, held=".*")
    theta, u = model.theta, measured[0].T.ravel()
    held = u[model.driven_dofs]
    theta[model.blocks["boundary"]] = np.concatenate([held.real, held.imag])
    alike = sp.csr_array(np.ones((nodes**2, 1)))
    fields = ParameterFields(theta, model.blocks, {"storage": Unknown(start, LogTransform(), alike)})
    return Reduced(model, LeastSquares(measured, sigma), fields, {"storage": ridge(fields.start)}, {"storage": 1.0}), u[
        None
    ]


def two_moduli(bulk_over_shear, nodes=13):
    """Shear and bulk modulus at every node, at their truth, of nearly incompressible tissue."""
    model = square(nodes, "Q2/L2(1)", 0.2, bulk_over_shear)
    data = model.evaluate(model.theta).data
    fields = ParameterFields(
        model.theta, model.blocks, {"storage": Unknown(MODULUS), "bulk": Unknown(bulk_over_shear * MODULUS)}
    )
    space = model.fields["storage"].space
    made = {name: smooth(space, fields.start[block]) for name, block in fields.blocks.items()}
    return Reduced(model, LeastSquares(data, scatter(data, 0.01)[0]), fields, made, dict.fromkeys(made, 100.0))
