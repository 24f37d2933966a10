"""Inverse problems: elastography, and parameters of any model from measured data.

- `problem`: The wave problem that is inverted: unknown properties, discretisation, boundary data.
- `data`: Quality of wave data before an inversion: noise, outliers, smoothing, time convention.
- `objective`: The objective function: misfit, parameter transforms, regularisers.
- `optimise`: Optimisers of a reduced objective, and selection of the regularisation weights.
- `elastography`: Property maps from wave data: `invert` in the plane, in slices and in 3-D.
- `subzones`: Inversion of large domains by overlapping subzones.
- `uncertainty`: Posterior covariance, credible intervals and maps.
- `fitting`: Parameters of any static or transient model, and of glued tissue specimens.
- `phantoms`: Benchmark phantoms with known properties.
"""

__all__ = [
    "data",
    "elastography",
    "fitting",
    "objective",
    "optimise",
    "phantoms",
    "problem",
    "subzones",
    "uncertainty",
]
