"""Harmonic waves at one frequency.

`problem` (`HarmonicProblem`), `wave` (excitation, absorbing boundaries), `factors` (matrices and factorisations), `integrands`,
`stiffness` of a body by elements, `about_state` (small waves on a deformed body).
"""

from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names

if TYPE_CHECKING:
    from ngbrain.forward.harmonic import about_state, factors, integrands, problem, stiffness, wave
else:
    __getattr__, __dir__ = lazy_names(__name__)

__all__ = ["about_state", "factors", "integrands", "problem", "stiffness", "wave"]
