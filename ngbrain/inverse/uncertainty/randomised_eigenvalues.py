"""The large eigenvalues of a symmetric matrix that is known by its products, by random vectors in two passes.

Products with random vectors span, nearly, what the large eigenvalues belong to; products with an orthonormal basis Q of that
span make Nyström's approximation

    A ≈ AQ (QᵀAQ)⁻¹ QᵀA

which A exceeds by a positive semi-definite rest: an inverse of 1 + A is never too small. Q (QᵀAQ) Qᵀ, of the same products,
can err both ways; a single pass, which takes random vectors for Q, is off by more the slower eigenvalues fall.

Sources: Halko, Martinsson, Tropp 2011, 10.1137/090771806 (algorithm 5.5); Saibaba, Lee, Kitanidis 2016, 10.1002/nla.2026.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

Array = np.ndarray
BLOCK, OVER = 32, 10
"""Random vectors at a time, and by how many these are more than the eigenvalues found."""
ROUND_OFF = 1e-13
"""Of the largest eigenvalue and one, below which a part of QᵀAQ is none."""


def eigenpairs(
    apply: Callable[[Array], Array], size: int, min_eigenvalue: float, random: np.random.Generator
) -> tuple[Array, Array]:
    """All eigenvalues above `least` (k,), largest first, and orthonormal eigenvectors (size, k).

    apply   a vector ↦ A times it, A symmetric and positive semi-definite; two products for each of about k + `OVER` vectors
    least   where what is left may be neglected; 0: nothing is

    >>> A = np.diag([9.0, 4.0, 0.5, 0.01])
    >>> values, vectors = eigenpairs(lambda v: A @ v, 4, 0.1, np.random.default_rng(0))
    >>> values.round(9).tolist(), np.abs(vectors[:, 0]).round(9).tolist()
    ([9.0, 4.0, 0.5], [1.0, 0.0, 0.0, 0.0])
    """
    basis, images = np.empty((size, 0)), np.empty((size, 0))
    number = 0
    while basis.shape[1] < min(size, number + OVER):
        new = _times(apply, random.normal(size=(size, min(BLOCK, size - basis.shape[1]))))
        for _ in range(2):  # once leaves round-off of the large eigenvalues
            new = np.linalg.qr(new - basis @ (basis.T @ new))[0]
        basis, images = np.hstack([basis, new]), np.hstack([images, _times(apply, new)])
        root = _root(basis, images)
        number = int(np.sum(np.linalg.eigvalsh(root.T @ (images.T @ images) @ root) > min_eigenvalue))
    if not size:
        return np.empty(0), basis
    vectors, roots, _ = np.linalg.svd(images @ _root(basis, images), full_matrices=False)
    values = roots**2
    return values[values > min_eigenvalue], vectors[:, values > min_eigenvalue]


def _root(basis: Array, images: Array) -> Array:
    """A matrix whose product with its transpose is (QᵀAQ)⁻¹."""
    small = basis.T @ images
    middle, turned = np.linalg.eigh((small + small.T) / 2)
    there = middle > ROUND_OFF * (1 + middle[-1])
    return np.asarray(turned[:, there] / np.sqrt(middle[there]))


def _times(apply: Callable[[Array], Array], columns: Array) -> Array:
    return np.stack([apply(column) for column in columns.T], axis=1)
