"""Harmonic waves at one frequency.

`problem` (`HarmonicProblem`), `wave` (excitation, absorbing boundaries), `factors` (matrices and factorisations), `integrands`,
`stiffness` of a body by elements, `about_state` (small waves on a deformed body).
"""

__all__ = ["about_state", "factors", "integrands", "problem", "stiffness", "wave"]
