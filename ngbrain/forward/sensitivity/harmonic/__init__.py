"""How waves change with parameters.

`wave_model` with its `slopes` and `hessian`; `prestressed` waves on an equilibrium (`prestressed_work`, `prestressed_factor`).
"""

__all__ = ["hessian", "prestressed", "prestressed_factor", "prestressed_work", "slopes", "wave_model"]
