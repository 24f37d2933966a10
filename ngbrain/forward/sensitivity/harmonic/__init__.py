"""Derivatives of time-harmonic waves with respect to parameters.

- `wave_model`: `WaveModel`, from parameters to displacements at measured points.
- `medium`: the protocols of a body under its waves and of the derivative of its system matrix.
- `at_rest`: a body at rest, with fields as parameters.
- `about_equilibrium`: a deformed body, whose equilibrium depends on the parameters too.
- `field_gradients`: derivatives of the system matrix with respect to fields, contracted with waves.
- `matrix_derivative`: the system matrix's derivative along a direction, for second derivatives.
- `state_work`: virtual work of small waves on a large static deformation.
"""

from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names

if TYPE_CHECKING:
    from ngbrain.forward.sensitivity.harmonic import (
        about_equilibrium,
        at_rest,
        field_gradients,
        matrix_derivative,
        medium,
        state_work,
        wave_model,
    )
else:
    __getattr__, __dir__ = lazy_names(__name__)

__all__ = [
    "about_equilibrium",
    "at_rest",
    "field_gradients",
    "matrix_derivative",
    "medium",
    "state_work",
    "wave_model",
]
