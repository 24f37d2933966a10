"""Linear and nonlinear solvers.

- nonlinear: `Newton`; `follow` a load path (`Path`), with the record of a solve in `NewtonRecord`, `PathRecord` and `SolverWork`
- linear, by name: `prepare` a solver of a form, `choose` one; `DirectSolver`, `KrylovSolver`, `ReusedFactorSolver`; `factorise`
- Krylov methods: `cg`, `truncated_cg`, `minres`, `gmres`
- preconditioners: `bddc`, `elastic_bddc`, `QuasiNewtonPreconditioner`
- static condensation: `Condensed`; conversion of matrices: `to_scipy`, `to_ngsolve`
- CPU or GPU: `Device`, `Factor`, `CpuFactor`, `OrderedFactor`, `CudssFactor`, `NgsolveFactor`

Modules
-------
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
- `nested_dissection`: an order of elimination from the elements.
- `matrices`: conversion between NGSolve's and SciPy's sparse matrices.
"""

from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names

if TYPE_CHECKING:
    from ngbrain.solvers import (
        condensed,
        continuation,
        device,
        direct,
        krylov,
        linear,
        matrices,
        multigrid,
        nested_dissection,
        newton,
        preconditioners,
        quasi_newton_preconditioner,
        record,
    )
    from ngbrain.solvers.condensed import Condensed
    from ngbrain.solvers.continuation import Path, follow
    from ngbrain.solvers.device import CpuFactor, CudssFactor, Device, Factor, NgsolveFactor, OrderedFactor
    from ngbrain.solvers.direct import factorise
    from ngbrain.solvers.krylov import cg, gmres, minres, truncated_cg
    from ngbrain.solvers.linear import DirectSolver, KrylovSolver, ReusedFactorSolver, choose, prepare
    from ngbrain.solvers.matrices import to_ngsolve, to_scipy
    from ngbrain.solvers.newton import Newton
    from ngbrain.solvers.preconditioners import bddc, elastic_bddc
    from ngbrain.solvers.quasi_newton_preconditioner import QuasiNewtonPreconditioner
    from ngbrain.solvers.record import NewtonRecord, PathRecord, SolverWork
else:
    __getattr__, __dir__ = lazy_names(__name__)

__all__ = [
    "Condensed",
    "CpuFactor",
    "CudssFactor",
    "Device",
    "DirectSolver",
    "Factor",
    "KrylovSolver",
    "Newton",
    "NewtonRecord",
    "NgsolveFactor",
    "OrderedFactor",
    "Path",
    "PathRecord",
    "QuasiNewtonPreconditioner",
    "ReusedFactorSolver",
    "SolverWork",
    "bddc",
    "cg",
    "choose",
    "condensed",
    "continuation",
    "device",
    "direct",
    "elastic_bddc",
    "factorise",
    "follow",
    "gmres",
    "krylov",
    "linear",
    "matrices",
    "minres",
    "multigrid",
    "nested_dissection",
    "newton",
    "preconditioners",
    "prepare",
    "quasi_newton_preconditioner",
    "record",
    "to_ngsolve",
    "to_scipy",
    "truncated_cg",
]
