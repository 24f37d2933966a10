"""How waves change with parameters.

`wave_model`, and what it asks of a `medium`: the matrix of a body `at_rest` changes with its fields (`slopes`, `hessian`), that
`about_equilibrium` of a deformed one with all that the body is made of (`state_work`).
"""

__all__ = ["about_equilibrium", "at_rest", "hessian", "medium", "slopes", "state_work", "wave_model"]
