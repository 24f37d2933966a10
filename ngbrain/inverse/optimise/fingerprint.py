"""Fingerprint of an inverse problem, part by part, by which a checkpoint is matched to its problem.

Parts are compared by their effect, not by their names: the wave operator by A(θ) u, regularisers and misfit by their
gradients, all at one random x and u, so that nothing cancels.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING

import ngsolve as ngs
import numpy as np

from ngbrain.forward.sensitivity.harmonic.wave_model import BOUNDARY

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from ngbrain.adjoint.reduced import Reduced
    from ngbrain.forward.sensitivity.harmonic.wave_model import WaveModel
    from ngbrain.inverse.objective.misfit import LeastSquares

Array = np.ndarray
ASIDE = 0.1
"""Root-mean-square distance of the random x from the initial guess."""
DIGITS = 5
"""Digits to which computed numbers are compared, relative to the largest: with several threads, sums differ in their last bits."""
FAR = 10.0
"""Residual (standard deviations) at which misfits are compared; there a robust misfit treats the data as outliers."""


def problem_fingerprint(reduced: Reduced) -> dict[str, str]:
    """Hash of each part of the inverse problem, by name.

    The model is a `WaveModel`, the misfit `LeastSquares` or derived from it. Nothing is factorised and the fields keep their
    values. Where the boundary displacements are unknown, another initial guess of them is the same problem.
    """
    model: WaveModel = reduced.model  # type: ignore[assignment]
    misfit: LeastSquares = reduced.misfit  # type: ignore[assignment]
    unknowns = reduced.unknowns
    x = unknowns.start + ASIDE * np.random.default_rng(0).normal(size=len(unknowns.start))
    theta = unknowns.theta(x)
    starts = [unknowns.start[block] for name, block in unknowns.blocks.items() if name != BOUNDARY]
    known = [theta[block] for name, block in model.blocks.items() if name != BOUNDARY or name not in unknowns.blocks]
    slopes = [
        regulariser.gradient(x[unknowns.blocks[name]]) for name, regulariser in sorted(reduced.regularisers.items())
    ]
    mesh = model.body.mesh
    return {
        "measured displacements": _hash(misfit.measured, misfit.known),
        "their noise": _hash(misfit.gradient(misfit.measured + FAR * misfit.sigma)),
        "points": _hash(model.points),
        "elements": _hash(
            str(model.body.form), [v.point for v in mesh.vertices], [len(e.vertices) for e in mesh.Elements()]
        ),
        "driven boundary": _hash(model.driven_dofs),
        "frequencies": _hash([wave.frequency for wave in model.body.waves]),
        "unknowns or their start": _hash_of_computed(" ".join(unknowns.blocks), [*starts, *known]),
        "material, density or fibres": _hash_of_computed(
            "", _operator_products(model, theta, np.random.default_rng(1))
        ),
        "regularisers": _hash_of_computed(" ".join(sorted(reduced.regularisers)), slopes),
    }


def differing_parts(one: object, other: Mapping[str, str]) -> list[str]:
    """Names of the parts of `other` that `one` lacks or has with another hash.

    Parameters
    ----------
    one : object
        Fingerprint read from a checkpoint; anything but a mapping counts as empty.
    other : mapping of str to str
        Fingerprint of the problem at hand.

    Returns
    -------
    list of str
        Names of the parts that differ.

    Examples
    --------
    >>> differing_parts({"points": "a", "elements": "b"}, {"points": "a", "elements": "c"})
    ['elements']
    """
    known = one if isinstance(one, Mapping) else {}
    return [name for name, value in other.items() if known.get(name) != value]


def _operator_products(model: WaveModel, theta: Array, random: np.random.Generator) -> list[Array]:
    """A(θ) u for each frequency, then the loads."""
    body = model.body
    u, test = ngs.GridFunction(body.fes), body.fes.TestFunction()
    u.vec.FV().NumPy()[:] = random.normal(size=(2, body.fes.ndof)).T @ [1, 1j]
    images = []
    with _temporary_fields(model, theta):
        for omega in sorted({wave.omega for wave in body.waves}):
            form = ngs.LinearForm(body.fes)
            form += body.terms(omega, u, test, lambda work: work)
            form.Assemble()
            images.append(form.vec.FV().NumPy().copy())
    return images + [body.load_vector(k) for k in range(len(body.waves))]


@contextmanager
def _temporary_fields(model: WaveModel, theta: Array) -> Iterator[None]:
    """Set the fields to θ temporarily; an inversion may be in progress."""
    before = {name: field.vec.FV().NumPy().copy() for name, field in model.fields.items()}
    try:
        for name, field in model.fields.items():
            field.vec.FV().NumPy()[:] = theta[model.blocks[name]]
        yield
    finally:
        for name, field in model.fields.items():
            field.vec.FV().NumPy()[:] = before[name]


def _hash(*parts: object) -> str:
    """Hash of bytes, exact."""
    found = hashlib.sha256()
    for part in parts:
        found.update(part.encode() if isinstance(part, str) else np.ascontiguousarray(part).tobytes())
    return found.hexdigest()


def _hash_of_computed(name: str, parts: Iterable[Array]) -> str:
    """Hash of computed arrays, rounded to `DIGITS` of the largest number of each."""
    found: list[object] = [name]
    for part in parts:
        values = np.ascontiguousarray(part)
        values = values.view(float) if np.iscomplexobj(values) else values
        largest = float(np.abs(values).max(initial=0.0))
        found += [f"{largest:.{DIGITS}e}", np.round(values / (largest or 1.0), DIGITS) + 0.0]  # no -0
    return _hash(*found)
