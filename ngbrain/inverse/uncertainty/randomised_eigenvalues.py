"""Dominant eigenvalues of a symmetric operator, by a randomised two-pass method.

Products with random vectors nearly span the dominant eigenspace; products with an orthonormal basis Q of that span give
Nyström's approximation

    A ≈ AQ (QᵀAQ)⁻¹ QᵀA

The remainder is positive semi-definite, so that the inverse of 1 + A is never too small. Q (QᵀAQ) Qᵀ, from the same products, errs
both ways; a single pass with random vectors as Q is the less accurate the more slowly the eigenvalues decay.

References
----------
Halko, Martinsson, Tropp 2011, 10.1137/090771806 (algorithm 5.5); Saibaba, Lee, Kitanidis 2016, 10.1002/nla.2026.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

Array = np.ndarray
BLOCK, OVERSAMPLING = 32, 10
"""Random vectors per batch, and their excess over the number of eigenvalues found."""
ROUND_OFF = 1e-13
"""Part of QᵀAQ that counts as zero, relative to the largest eigenvalue plus one."""


def eigenpairs(
    apply: Callable[[Array], Array], size: int, min_eigenvalue: float, random: np.random.Generator
) -> tuple[Array, Array]:
    """Compute all eigenvalues above a threshold and their eigenvectors.

    Parameters
    ----------
    apply : callable
        v ↦ A v, with A symmetric positive semi-definite; called twice for each of about k + `OVERSAMPLING` vectors.
    size : int
        Size of A.
    min_eigenvalue : float
        Threshold; with 0, all eigenvalues.
    random : Generator
        Random numbers.

    Returns
    -------
    values : array (k,)
        Eigenvalues in descending order.
    vectors : array (size, k)
        Orthonormal eigenvectors.

    Examples
    --------
    >>> A = np.diag([9.0, 4.0, 0.5, 0.01])
    >>> values, vectors = eigenpairs(lambda v: A @ v, 4, 0.1, np.random.default_rng(0))
    >>> values.round(9).tolist(), np.abs(vectors[:, 0]).round(9).tolist()
    ([9.0, 4.0, 0.5], [1.0, 0.0, 0.0, 0.0])
    """
    basis, images = np.empty((size, 0)), np.empty((size, 0))
    number = 0
    while basis.shape[1] < min(size, number + OVERSAMPLING):
        new = _apply_to_columns(apply, random.normal(size=(size, min(BLOCK, size - basis.shape[1]))))
        for _ in range(2):  # one pass leaves round-off of the large eigenvalues
            new = np.linalg.qr(new - basis @ (basis.T @ new))[0]
        basis, images = np.hstack([basis, new]), np.hstack([images, _apply_to_columns(apply, new)])
        root = _root(basis, images)
        number = int(np.sum(np.linalg.eigvalsh(root.T @ (images.T @ images) @ root) > min_eigenvalue))
    if not size:
        return np.empty(0), basis
    vectors, roots, _ = np.linalg.svd(images @ _root(basis, images), full_matrices=False)
    values = roots**2
    return values[values > min_eigenvalue], vectors[:, values > min_eigenvalue]


def _root(basis: Array, images: Array) -> Array:
    """Matrix whose product with its transpose is (QᵀAQ)⁻¹."""
    small = basis.T @ images
    middle, turned = np.linalg.eigh((small + small.T) / 2)
    there = middle > ROUND_OFF * (1 + middle[-1])
    return np.asarray(turned[:, there] / np.sqrt(middle[there]))


def _apply_to_columns(apply: Callable[[Array], Array], columns: Array) -> Array:
    return np.stack([apply(column) for column in columns.T], axis=1)
