"""Inversions of phantoms whose truth is drawn from the prior."""

from ngbrain.adjoint.reduced import Reduced
from ngbrain.inverse.objective.parameters import ParameterFields
from ngbrain.inverse.objective.regularisation import matern
from ngbrain.inverse.optimise.gauss_newton import GaussNewton
from ngbrain.inverse.optimise.regularisation_weight import FixedWeights
from ngbrain.inverse.phantoms.benchmark import Phantom
from ngbrain.inverse.phantoms.prior_draws import draw_phantom


def prior(space, x):
    """Bumps of 3 cm."""
    return matern(space, x, 0.03)


def begun(weight=5.0, noise=0.02, nodes=7, seed=0):
    """The inverse problem of a viscoelastic phantom; ln moduli deviate by about .44/√weight."""
    return (
        draw_phantom(Phantom.from_name("CV-G", nodes), prior, weight, seed)
        .simulate_measurements(noise, seed)
        .inversion(prior, weight)
    )


def settled(weight=5.0, noise=0.02, nodes=7, seed=0):
    """The same, and the point where it ends."""
    inversion = begun(weight, noise, nodes, seed)
    return inversion, descended(inversion.reduced)


def descended(reduced):
    """The minimum of J, at the weights as they are."""
    return reduced.evaluate(GaussNewton(reduced, FixedWeights()).descend(reduced.unknowns.start).x)


def boundary_as_measured(inversion):
    """The problem with the measured boundary displacements taken as exact, noise included."""
    reduced = inversion.reduced
    unknowns = {name: each for name, each in reduced.unknowns.unknowns.items() if name != "boundary"}
    fields = ParameterFields(reduced.unknowns.theta(inversion.start), inversion.model.blocks, unknowns)
    return Reduced(reduced.model, reduced.misfit, fields, reduced.regularisers, reduced.weights)
