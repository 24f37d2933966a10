"""Linear and nonlinear solvers.

- `newton`: an error-oriented Newton method that keeps its factorisation.
- `continuation`: load steps with a predictor, cut where one fails.
- `record`: what a solve did: iterations, operation counts, CPU time.
- `linear`: linear solvers by name, and the choice between them.
- `direct`: direct factorisations.
- `krylov`: conjugate gradients, MINRES and GMRES.
- `preconditioners`: BDDC, multigrid and block-diagonal preconditioners.
- `multigrid`: a multigrid cycle for displacements of any order.
- `quasi_newton_preconditioner`: a preconditioner improved by earlier conjugate-gradient directions.
- `condensed`: an assembled form with static condensation.
- `device`: factorisation on the CPU or on a GPU.
- `matrices`: conversion between NGSolve's and SciPy's sparse matrices.
"""

__all__ = [
    "condensed",
    "continuation",
    "device",
    "direct",
    "krylov",
    "linear",
    "matrices",
    "multigrid",
    "newton",
    "preconditioners",
    "quasi_newton_preconditioner",
    "record",
]
