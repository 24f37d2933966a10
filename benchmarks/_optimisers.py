"""The optimisers that are compared on every inverse problem."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from ngbrain.inverse import OptimisationResult, bfgs, l_bfgs, levenberg_marquardt, newton_cg

OURS = "Levenberg-Marquardt"
OPTIMISERS: dict[str, Callable[..., OptimisationResult]] = {
    OURS: levenberg_marquardt,
    "Gauss-Newton": partial(levenberg_marquardt, initial_damping=1e-6),
    "BFGS": bfgs,
    "L-BFGS": l_bfgs,
    "Newton-CG": newton_cg,
}
COLOURS = dict(zip(OPTIMISERS, ("#0072B2", "#CC79A7", "#E69F00", "#D55E00", "#009E73"), strict=True))
