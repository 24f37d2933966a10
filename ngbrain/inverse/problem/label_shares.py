"""Fields that are smooth inside a label and free to jump between labels, on meshes that know nothing of the labels.

    G(x) = Σ_l s_l(x) G_l(x)

s_l is 1 where label l is and 0 elsewhere, given at the quadrature points, so that a label's border may cut elements; G_l are
fields of their own with regularisers of their own. A node far from its label is held by the regulariser alone.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import ngsolve as ngs
import numpy as np
from ngsolve import CoefficientFunction

from ngbrain.errors import InputError
from ngbrain.forward.common.interpolation import quadrature_field, quadrature_points

Array = np.ndarray


def label_shares(
    mesh: ngs.Mesh, degree: int, label_at: Callable[[Array], Array], names: Sequence[str]
) -> dict[str, ngs.GridFunction]:
    """Name → s_l, at the quadrature points of a `HarmonicProblem` with `quadrature=degree`; for use in its integrals alone.

    label_at   points (n, dim) m → numbers (n,) from 0 on, indices into `names`

    Raises `InputError` for a number without a name.

    >>> from ngbrain.mesh.geometry.structured import rectangles
    >>> mesh = rectangles(np.linspace(0, 1, 5), np.linspace(0, 1, 5))
    >>> found = label_shares(mesh, 2, lambda points: (points[:, 0] > 0.5).astype(int), ["left", "right"])
    >>> [round(float(s.vec.FV().NumPy().mean()), 3) for s in found.values()]
    [0.5, 0.5]
    """
    space, points = quadrature_points(mesh, degree)
    numbers = np.asarray(label_at(points))
    if numbers.min() < 0 or numbers.max() >= len(names):
        raise InputError("labels", f"from {numbers.min()} to {numbers.max()}", f"numbers from 0 to {len(names) - 1}")
    return {name: quadrature_field(space, numbers == number) for number, name in enumerate(names)}


def combine_labels(
    shares: Mapping[str, ngs.GridFunction], fields: Mapping[str, CoefficientFunction]
) -> CoefficientFunction:
    """Σ s_l G_l; `InputError` unless every label has a field."""
    if missing := set(shares) - set(fields):
        raise InputError("fields", f"without {', '.join(sorted(missing))}", "a field for each label")
    first, *rest = (share * fields[name] for name, share in shares.items())
    return sum(rest, first)
