"""Models from parameters to data, with first and second derivatives (adjoint and tangent-linear).

- `static_model`: bodies in static equilibrium (`StaticModel`).
- `transient`: time-dependent viscoelastic runs (`RunModel`).
- `harmonic`: time-harmonic waves (`WaveModel`).
- `parameters`: parameters that models accept; their blocks of θ are in `parameter_blocks` (fields, numbers, prescribed
  displacements) and `node_positions`.
- `static_equilibrium`: one load case, its equilibrium and the forms that derivatives need.
- `tangent_inverse`: solves with the tangent at equilibrium and with its transpose.
- `contact_work`: virtual work of contacts and loads, and its derivatives.
- `reference_shape`: positions in the loaded body, for finding its unloaded shape.
- `differences`: a central difference quotient of eighth order.
"""

from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names

if TYPE_CHECKING:
    from ngbrain.forward.sensitivity import (
        contact_work,
        differences,
        harmonic,
        node_positions,
        parameter_blocks,
        parameters,
        reference_shape,
        static_equilibrium,
        static_model,
        tangent_inverse,
        transient,
    )
else:
    __getattr__, __dir__ = lazy_names(__name__)

__all__ = [
    "contact_work",
    "differences",
    "harmonic",
    "node_positions",
    "parameter_blocks",
    "parameters",
    "reference_shape",
    "static_equilibrium",
    "static_model",
    "tangent_inverse",
    "transient",
]
