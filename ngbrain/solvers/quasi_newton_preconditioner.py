"""What conjugate gradients have learnt of a matrix, kept for the next system with nearly the same one."""

from __future__ import annotations

from collections import deque

import numpy as np

from ngbrain.solvers.krylov import Apply

Array = np.ndarray
KEPT = 150
"""Directions: each as long as a vector of unknowns, twice."""


class QuasiNewtonPreconditioner:
    """The latest directions s and their images G s, as BFGS corrections of a preconditioner for G + R.

    most   how many are kept

    G is what is dear to apply, R a matrix that may change between systems. The corrected preconditioner is positive definite
    whenever the one it corrects is, and maps (G + R) s to s for the last s.
    Source: Morales and Nocedal 2000, 10.1137/S1052623497327854.

    >>> found = QuasiNewtonPreconditioner()
    >>> found.add(np.array([1.0, 0.0]), np.array([4.0, 0.0]))
    >>> found.correct(lambda r: r, lambda s: 0 * s)(np.array([4.0, 3.0])).tolist()
    [1.0, 3.0]
    """

    def __init__(self, most: int = KEPT) -> None:
        self._pairs: deque[tuple[Array, Array]] = deque(maxlen=most)

    def add(self, s: Array, image: Array) -> None:
        """One more direction and G times it."""
        size = float(np.linalg.norm(s))
        if size > 0:
            self._pairs.append((s / size, image / size))

    @property
    def arrays(self) -> Array:
        """All of them, normed, each with its image: (kept, 2, n)."""
        return np.array(self._pairs)

    @arrays.setter
    def arrays(self, values: Array) -> None:
        self._pairs.clear()
        self._pairs.extend((s, image) for s, image in values)

    def correct(self, precondition: Apply, rest: Apply) -> Apply:
        """`precondition` with what is known; `rest` applies R."""
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
