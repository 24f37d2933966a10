"""A preconditioner updated by earlier conjugate-gradient directions, for a sequence of similar systems."""

from __future__ import annotations

from collections import deque

import numpy as np

from ngbrain.solvers.krylov import Apply

Array = np.ndarray
KEPT = 150
"""Directions kept by default; each takes two vectors."""


class QuasiNewtonPreconditioner:
    """Limited-memory BFGS update of a preconditioner for G + R, from directions s and images G s.

    G is expensive to apply; R may change between systems. The updated preconditioner is positive definite if the original one
    is, and maps (G + R) s to s for the last s.

    Parameters
    ----------
    most : int
        Number of directions kept, the latest ones.

    References
    ----------
    Morales and Nocedal 2000, https://doi.org/10.1137/S1052623497327854.

    Examples
    --------
    >>> found = QuasiNewtonPreconditioner()
    >>> found.add(np.array([1.0, 0.0]), np.array([4.0, 0.0]))
    >>> found.correct(lambda r: r, lambda s: 0 * s)(np.array([4.0, 3.0])).tolist()
    [1.0, 3.0]
    """

    def __init__(self, most: int = KEPT) -> None:
        self._pairs: deque[tuple[Array, Array]] = deque(maxlen=most)

    def add(self, s: Array, image: Array) -> None:
        """Store a direction.

        Parameters
        ----------
        s : array (n,)
            Direction.
        image : array (n,)
            G s.
        """
        size = float(np.linalg.norm(s))
        if size > 0:
            self._pairs.append((s / size, image / size))

    @property
    def arrays(self) -> Array:
        """Stored directions, normalised, each with its image: (stored, 2, n)."""
        return np.array(self._pairs)

    @arrays.setter
    def arrays(self, values: Array) -> None:
        self._pairs.clear()
        self._pairs.extend((s, image) for s, image in values)

    def correct(self, precondition: Apply, rest: Apply) -> Apply:
        """The updated preconditioner.

        Parameters
        ----------
        precondition : callable
            The original preconditioner, r → Pr.
        rest : callable
            s → R s.

        Returns
        -------
        callable
            The updated preconditioner; the original one where no direction is stored.
        """
        known = []
        for s, image in self._pairs:
            y = image + rest(s)
            if (along := float(s @ y)) > 0:
                known.append((s, y, 1 / along))
        if not known:
            return precondition

        def apply(r: Array) -> Array:
            q, steps = r.copy(), []
            for s, y, scale in reversed(known):
                steps.append(scale * float(s @ q))
                q -= steps[-1] * y
            z = np.array(precondition(q))
            for (s, y, scale), step in zip(known, reversed(steps), strict=True):
                z += (step - scale * float(y @ z)) * s
            return z

        return apply
