"""Parameters → data, with derivatives: of equilibria here, of runs in `transient`, of waves in `harmonic`.

`static_model` (equilibria by `static_equilibrium`, their `tangent_inverse`), `parameter_blocks`, `contact_work` as expressions to
be differentiated, `reference_shape` of a loaded body, `differences`.
"""

__all__ = [
    "contact_work",
    "differences",
    "harmonic",
    "parameter_blocks",
    "reference_shape",
    "static_equilibrium",
    "static_model",
    "tangent_inverse",
    "transient",
]
