"""Fields that are smooth within a label and may jump between labels, on meshes that do not follow the labels.

    G(x) = Σ_l s_l(x) G_l(x)

The indicator s_l is 1 in label l and 0 elsewhere. It is given at the quadrature points, so the border of a label may cut
elements. Each G_l is a field with a regulariser of its own. At nodes far from its label only the regulariser determines it.
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
    """Return the indicators s_l of labels at the quadrature points.

    Parameters
    ----------
    mesh : ngsolve.Mesh
        Mesh in m.
    degree : int
        `quadrature` of the `HarmonicProblem` that uses the indicators. They are valid in its integrals only.
    label_at : callable
        Points (n, dim) m → label numbers (n,) from 0 on, indices into `names`.
    names : sequence of str
        Names of the labels.

    Returns
    -------
    dict of str to ngsolve.GridFunction
        Name → s_l.

    Raises
    ------
    InputError
        A label number has no name.

    Examples
    --------
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
    """Return Σ s_l G_l.

    Parameters
    ----------
    shares : mapping of str to ngsolve.GridFunction
        Label → indicator s_l, as `label_shares` returns them.
    fields : mapping of str to ngsolve.CoefficientFunction
        Label → field G_l.

    Returns
    -------
    ngsolve.CoefficientFunction
        The combined field.

    Raises
    ------
    InputError
        A label has no field.
    """
    if missing := set(shares) - set(fields):
        raise InputError("fields", f"without {', '.join(sorted(missing))}", "a field for each label")
    first, *rest = (share * fields[name] for name, share in shares.items())
    return sum(rest, first)
