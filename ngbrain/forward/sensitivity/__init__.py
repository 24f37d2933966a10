"""Parameters → data, with derivatives: of equilibria here, of runs in `transient`, of waves in `harmonic`.

`static_model` (equilibria by `static_equilibrium`, their `tangent_inverse`), `parameter_blocks`, `virtual_work` and `contact_work`
as expressions to be differentiated, `observations` and `readings` of a state, `reference_shape` of a loaded body, `differences`.
"""

__all__ = [
    "contact_work",
    "differences",
    "harmonic",
    "observations",
    "parameter_blocks",
    "readings",
    "reference_shape",
    "static_equilibrium",
    "static_model",
    "tangent_inverse",
    "transient",
    "virtual_work",
]
