"""An elimination order for sparse matrices of finite elements: nested dissection by elements.

The elements are halved across their longest side again and again. The unknowns of one half are eliminated before, and those
shared by both halves after, the unknowns of either half alone. Unknowns of all elements, such as the value of a region, come
last of all.

References
----------
George 1973, nested dissection of a regular finite element mesh, https://doi.org/10.1137/0710032.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

Array = np.ndarray
SAME = 1e-6
"""Centres whose coordinates differ by less than this share of their mean distance lie in one line."""


def nested_dissection(incidence: sp.csr_array, centres: Array) -> Array:
    """Return an elimination order of few new entries.

    Parameters
    ----------
    incidence : sparse array (n, elements)
        Nonzero where an unknown belongs to an element.
    centres : array (elements, dim)
        Centres of the elements.

    Returns
    -------
    array of int (n,)
        The unknowns in the order of their elimination.

    Examples
    --------
    Three elements in a line between four nodes; the node in the middle comes last.

    >>> line = sp.csr_array(np.array([[1, 0, 0], [1, 1, 0], [0, 1, 1], [0, 0, 1]]))
    >>> nested_dissection(line, np.array([[0.0], [1.0], [2.0]])).tolist()
    [0, 3, 2, 1]
    """
    touches = sp.csr_array(incidence, dtype=float)
    order: list[Array] = []

    def number(elements: Array, unknowns: Array) -> None:
        if len(elements) < 2:
            order.append(unknowns)
            return
        first, second = _halves(centres[elements])
        sides = np.zeros((2, touches.shape[1]))
        sides[0, elements[first]] = sides[1, elements[second]] = 1
        in_first, in_second = (touches[unknowns] @ sides.T > 0).T
        number(elements[first], unknowns[in_first & ~in_second])
        number(elements[second], unknowns[in_second & ~in_first])
        order.append(unknowns[in_first == in_second])

    number(np.arange(touches.shape[1]), np.arange(touches.shape[0]))
    return np.concatenate(order)


def _halves(centres: Array) -> tuple[Array, Array]:
    """Places of the centres on each side of a cut across their longest side; between lines of centres where there are any."""
    axis = np.ptp(centres, axis=0).argmax()
    places = np.argsort(centres[:, axis], kind="stable")
    gaps = np.diff(centres[places, axis])
    cuts = np.flatnonzero(gaps > SAME * gaps.mean())
    if not len(cuts):
        cuts = np.arange(len(gaps))
    cut = 1 + cuts[np.abs(cuts + 1 - len(places) / 2).argmin()]
    return places[:cut], places[cut:]
