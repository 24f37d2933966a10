"""The harmonic problem of a scene, and the requested amplitudes."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import Any

import ngsolve as ngs
import numpy as np

from ngbrain.forward.harmonic.problem import HarmonicProblem
from ngbrain.forward.harmonic.wave import Wave
from ngbrain.forward.observables.percentiles import weighted_percentile
from ngbrain.ladder.levels import Model
from ngbrain.ladder.models.motions import PrescribedMotion
from ngbrain.ladder.quantities import mesh_components, mesh_point, quadrature_in_region
from ngbrain.materials import Shearing
from ngbrain.materials.base import Value
from ngbrain.materials.families import relaxation_time, shear_modulus
from ngbrain.scene import DisplacementBC, Quantity, Scene, Tissue

Array = np.ndarray
PHASES = 16
"""Phases of a period over which the largest strain is taken."""


def complex_modulus(tissue: Tissue, omega: float, loss: bool) -> complex:
    """Complex shear modulus G*(ω) = μ (1 + i tan δ) + Σ μ_k iωτ_k/(1 + iωτ_k) of the equilibrium part and the branches.

    Parameters
    ----------
    tissue : Tissue
    omega : float
        Angular frequency (1/s).
    loss : bool
        Whether it has a loss modulus; else the real part only.

    Returns
    -------
    complex
        In Pa.

    Examples
    --------
    >>> complex_modulus(Tissue(mu=1000.0, loss_tangent=0.2), 300.0, True)
    (1000+200j)
    """
    law = tissue.law()
    total = float(shear_modulus(law.equilibrium)) * complex(1, tissue.loss_tangent)
    for branch in law.branches:
        turned = 1j * omega * float(relaxation_time(branch))
        total += float(shear_modulus(branch.law)) * turned / (1 + turned)
    return total if loss else complex(total.real)


def harmonic_answers(
    scene: Scene,
    model: Model,
    mesh: ngs.Mesh,
    tissue: Callable[[str], tuple[Tissue, Value]],
    form: str,
    thickness: float,
) -> tuple[Array, int]:
    """Solve the harmonic problem of a scene and evaluate its quantities.

    Parameters
    ----------
    scene : Scene
    model : mapping of str
        Axis → level.
    mesh : ngs.Mesh
    tissue : callable
        From a region to its tissue and the factor of its moduli.
    form : str
        Elements, such as "P2/P1".
    thickness : float
        Thickness (m) of a section, else 1.

    Returns
    -------
    answers : (n,) array
        Amplitudes, SI units.
    ndof : int
        Number of unknowns.
    """
    frequency, plane = scene.time.frequency or 0.0, mesh.dim == 2
    regions = {region: tissue(region) for region in sorted(set(mesh.GetMaterials()))}
    omega = 2 * np.pi * frequency
    moduli = {name: complex_modulus(each, omega, model.get("loss") == "all") for name, (each, _) in regions.items()}
    factor = mesh.MaterialCF({name: times for name, (_, times) in regions.items()})
    # A real and an imaginary field: NGSolve takes no complex constants by region.
    G = mesh.MaterialCF({name: G.real for name, G in moduli.items()})
    if any(G.imag for G in moduli.values()):
        G = G + 1j * mesh.MaterialCF({name: each.imag for name, each in moduli.items()})
    G = factor * G
    given = [g for g in scene.displacement_bcs if any(re.fullmatch(g.boundary, name) for name in mesh.GetBoundaries())]
    held = {axis: "|".join(g.boundary for g in given if axis in g.components) for axis in "xyz"}
    names = dict(zip("xy", "xz", strict=True)) if plane else dict(zip("xyz", "xyz", strict=True))
    course = PrescribedMotion(lambda _: (0.0, 1.0), plane)
    body = HarmonicProblem(
        mesh,
        Shearing(G),
        [
            Wave(
                frequency if model["inertia"] == "all" else 0.0,
                {g.boundary: _moved(course, g) for g in given if any(g.value)},
                {traction.boundary: course.vector(traction.value) for traction in scene.tractions},
            )
        ],
        bulk=factor * mesh.MaterialCF({name: each.bulk for name, (each, _) in regions.items()}),
        density=mesh.MaterialCF({name: each.rho for name, (each, _) in regions.items()}),
        form=form,
        dirichlet={mine: held[own] for mine, own in names.items() if held[own]},
    )
    (gfu,) = body.solve()
    return np.array([_amplitude(quantity, body, gfu, thickness) for quantity in scene.quantities]), body.fes.ndof


def _moved(course: PrescribedMotion, bc: DisplacementBC) -> tuple[Any, ...]:
    """Amplitude (m); 0 for free components, which are not used."""
    parts: Any = course.support(bc)
    return tuple(0.0 if part is None else part for part in parts)


def _amplitude(quantity: Quantity, body: HarmonicProblem, gfu: ngs.GridFunction, thickness: float) -> float:
    plane = body.mesh.dim == 2
    u = body.split(gfu)[0]
    if quantity.name == "displacement":
        return abs(
            complex(np.dot(u(mesh_point(body.mesh, quantity, plane)), mesh_components(quantity.unit_vector, plane)))
        )
    if quantity.name == "force":
        return abs(_force(quantity, body, gfu)) * thickness
    return weighted_percentile(*_strains(quantity, body, u), quantity.percentile)


def _force(quantity: Quantity, body: HarmonicProblem, gfu: ngs.GridFunction) -> complex:
    """Force on a boundary along the question's direction, as its virtual work."""
    (wave,) = body.waves
    form = ngs.BilinearForm(body.fes)
    trial, test = body.fes.TnT()
    form += body.terms(wave.omega, trial, test, lambda work: work)
    motion = ngs.GridFunction(body.fes)
    part = motion.components[0] if body.mixed else motion
    boundary = body.mesh.Boundaries(str(quantity.boundary))
    part.Set(ngs.CF(mesh_components(quantity.unit_vector, body.mesh.dim == 2)), definedon=boundary, dual=True)
    form.Assemble()
    product = gfu.vec.CreateVector()
    product.data = form.mat * gfu.vec
    return complex(np.dot(motion.vec.FV().NumPy(), product.FV().NumPy()))


def _strains(quantity: Quantity, body: HarmonicProblem, u: ngs.CoefficientFunction) -> tuple[Array, Array]:
    """Largest principal strains over a period at points, and the volumes that they represent."""
    mesh = body.mesh
    points, weights = quadrature_in_region(mesh, quantity)
    grad = ngs.Grad(u)
    values = np.array(ngs.CF(tuple(grad[i, j] for i in range(mesh.dim) for j in range(mesh.dim)))(points))
    gradient = np.zeros((len(values), 3, 3), complex)
    gradient[:, : mesh.dim, : mesh.dim] = values.reshape(-1, mesh.dim, mesh.dim)
    strain = (gradient + gradient.transpose(0, 2, 1)) / 2
    phases: Sequence[complex] = np.exp(2j * np.pi * np.arange(PHASES) / PHASES)
    largest = np.max([np.linalg.eigvalsh((strain * phase).real)[:, -1] for phase in phases], axis=0)
    return largest, weights
