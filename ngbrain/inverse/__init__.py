"""Inverse problems: elastography, and parameters of any model from measured data.

Property maps from wave data
    `invert` (in the plane, in slices and in 3-D), `invert_in_space`, `invert_by_subzones`; their result is an `Inversion`, with a
    `StartResult` for each start; `unknowns_from_maps` starts from given maps.
    Without an optimisation: `helmholtz`, `helmholtz_of_curl`, `navier` (direct inversion), `local_frequency`.
Wave data
    `noise_deviation`, `octahedral_shear_strain`, `screen_outliers`, `remove_outliers`, `fit_smooth_field`; `StiffnessMap` and
    `read_stiffness` of measured maps.
Maps
    `map_statistics`, `statistics_by_label`, `relative_l2_error`, `parameters_from_shear`, `fibre_shear_moduli`.
The wave problem that is inverted
    `ElastographyProblem` on a `Discretisation`, made by `discretise`, `coarse_discretisation` or
    `original_discretisation`; `field_observations`,
    `fit_field`, `label_shares`, `combine_labels` of its fields.
Parameters of any model
    `estimate`, `ParameterEstimate`; `BondedSpecimen`, `BondedFit` of glued tissue cubes.
Objective function
    misfits `LeastSquares`, `Huber`; unknowns `ParameterFields` of an `Unknown` each, with a `Transform`: `LogTransform`,
    `BoundedTransform`, `ScaledTransform`; regularisers `smooth`, `ridge`, `matern`, `total_variation`, `QuadraticRegulariser`.
Optimisers
    `GaussNewton` (plane waves), `GaussNewtonCG` (waves in 3-D), `levenberg_marquardt`, `bfgs`, `l_bfgs`, `newton_cg` (any model);
    `OptimisationResult`, `Iteration`; `Metric` and `GaussNewtonHessian` of an objective.
Regularisation weights
    `Evidence`, `EvidenceWithModelError`, `DiscrepancyPrinciple`, `FixedWeights` (each a `WeightPolicy`), `l_curve_corner`.
Uncertainty
    `Posterior`, `Uncertainty` (error bars of maps), `CredibleInterval`, `GaussianPrior`.
Phantoms
    `Phantom`, `PHANTOMS` (published ones by name), `PhantomData`, `PhantomInversion`, `draw_phantom`.

Modules
-------
- `problem`: The wave problem that is inverted: unknown properties, discretisation, boundary data.
- `data`: Quality of wave data before an inversion: noise, outliers, smoothing, time convention.
- `objective`: The objective function: misfit, parameter transforms, regularisers.
- `optimise`: Optimisers of a reduced objective, and selection of the regularisation weights.
- `elastography`: Property maps from wave data.
- `subzones`: Inversion of large domains by overlapping subzones.
- `uncertainty`: Posterior covariance, credible intervals and maps.
- `fitting`: Parameters of any static or transient model, and of glued tissue specimens.
- `phantoms`: Benchmark phantoms with known properties.
"""

from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names

if TYPE_CHECKING:
    from ngbrain.inverse import (
        data,
        elastography,
        fitting,
        objective,
        optimise,
        phantoms,
        problem,
        subzones,
        uncertainty,
    )
    from ngbrain.inverse.data.direct_inversion import helmholtz, helmholtz_of_curl, local_frequency, navier
    from ngbrain.inverse.data.outliers import remove_outliers, screen_outliers
    from ngbrain.inverse.data.quality import noise_deviation, octahedral_shear_strain
    from ngbrain.inverse.data.smoothing import fit_smooth_field
    from ngbrain.inverse.data.stiffness_maps import StiffnessMap, read_stiffness
    from ngbrain.inverse.elastography.derived_maps import (
        map_statistics,
        parameters_from_shear,
        relative_l2_error,
        statistics_by_label,
    )
    from ngbrain.inverse.elastography.identifiability import fibre_shear_moduli
    from ngbrain.inverse.elastography.initial_guess import unknowns_from_maps
    from ngbrain.inverse.elastography.invert import invert
    from ngbrain.inverse.elastography.invert_3d import invert_in_space
    from ngbrain.inverse.elastography.result import Inversion, StartResult
    from ngbrain.inverse.fitting.bonded_specimen import BondedFit, BondedSpecimen
    from ngbrain.inverse.fitting.estimate import ParameterEstimate, estimate
    from ngbrain.inverse.objective.misfit import Huber, LeastSquares
    from ngbrain.inverse.objective.parameters import (
        BoundedTransform,
        LogTransform,
        ParameterFields,
        ScaledTransform,
        Transform,
        Unknown,
    )
    from ngbrain.inverse.objective.regularisation import QuadraticRegulariser, matern, ridge, smooth, total_variation
    from ngbrain.inverse.optimise.gauss_newton import GaussNewton
    from ngbrain.inverse.optimise.gauss_newton_cg import GaussNewtonCG
    from ngbrain.inverse.optimise.gauss_newton_hessian import GaussNewtonHessian, Metric
    from ngbrain.inverse.optimise.levenberg_marquardt import levenberg_marquardt
    from ngbrain.inverse.optimise.quasi_newton import bfgs, l_bfgs, newton_cg
    from ngbrain.inverse.optimise.regularisation_weight import (
        DiscrepancyPrinciple,
        Evidence,
        EvidenceWithModelError,
        FixedWeights,
        WeightPolicy,
        l_curve_corner,
    )
    from ngbrain.inverse.optimise.result import Iteration, OptimisationResult
    from ngbrain.inverse.phantoms.benchmark import PHANTOMS, Phantom, PhantomData, PhantomInversion
    from ngbrain.inverse.phantoms.prior_draws import draw_phantom
    from ngbrain.inverse.problem.discretisation import (
        Discretisation,
        coarse_discretisation,
        discretise,
        original_discretisation,
    )
    from ngbrain.inverse.problem.field_values import field_observations, fit_field
    from ngbrain.inverse.problem.label_shares import combine_labels, label_shares
    from ngbrain.inverse.problem.wave_problem import ElastographyProblem
    from ngbrain.inverse.subzones.invert import invert_by_subzones
    from ngbrain.inverse.uncertainty.credible_maps import Uncertainty
    from ngbrain.inverse.uncertainty.evidence import GaussianPrior
    from ngbrain.inverse.uncertainty.interval import CredibleInterval
    from ngbrain.inverse.uncertainty.posterior import Posterior
else:
    __getattr__, __dir__ = lazy_names(__name__)

__all__ = [
    "PHANTOMS",
    "BondedFit",
    "BondedSpecimen",
    "BoundedTransform",
    "CredibleInterval",
    "DiscrepancyPrinciple",
    "Discretisation",
    "ElastographyProblem",
    "Evidence",
    "EvidenceWithModelError",
    "FixedWeights",
    "GaussNewton",
    "GaussNewtonCG",
    "GaussNewtonHessian",
    "GaussianPrior",
    "Huber",
    "Inversion",
    "Iteration",
    "LeastSquares",
    "LogTransform",
    "Metric",
    "OptimisationResult",
    "ParameterEstimate",
    "ParameterFields",
    "Phantom",
    "PhantomData",
    "PhantomInversion",
    "Posterior",
    "QuadraticRegulariser",
    "ScaledTransform",
    "StartResult",
    "StiffnessMap",
    "Transform",
    "Uncertainty",
    "Unknown",
    "WeightPolicy",
    "bfgs",
    "coarse_discretisation",
    "combine_labels",
    "data",
    "discretise",
    "draw_phantom",
    "elastography",
    "estimate",
    "fibre_shear_moduli",
    "field_observations",
    "fit_field",
    "fit_smooth_field",
    "fitting",
    "helmholtz",
    "helmholtz_of_curl",
    "invert",
    "invert_by_subzones",
    "invert_in_space",
    "l_bfgs",
    "l_curve_corner",
    "label_shares",
    "levenberg_marquardt",
    "local_frequency",
    "map_statistics",
    "matern",
    "navier",
    "newton_cg",
    "noise_deviation",
    "objective",
    "octahedral_shear_strain",
    "optimise",
    "original_discretisation",
    "parameters_from_shear",
    "phantoms",
    "problem",
    "read_stiffness",
    "relative_l2_error",
    "remove_outliers",
    "ridge",
    "screen_outliers",
    "smooth",
    "statistics_by_label",
    "subzones",
    "total_variation",
    "uncertainty",
    "unknowns_from_maps",
]
