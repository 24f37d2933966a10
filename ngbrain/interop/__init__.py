"""Models and objectives as differentiable functions of other libraries, one module each.

- the interface that all of them adapt: `Function`, of a model's data `DataFunction`, of an objective `ObjectiveFunction`
- of `scipy.optimize`: `Objective`

Modules
-------
- `function`: the interface that all of them adapt.
- `jax`: JAX, with derivatives of both directions.
- `scipy`: objectives for `scipy.optimize`.
- `torch`: PyTorch autograd.
- `umbridge`: UM-Bridge, models over HTTP.
"""

from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names

if TYPE_CHECKING:
    from ngbrain.interop import function, jax, scipy, torch, umbridge
    from ngbrain.interop.function import DataFunction, Function, ObjectiveFunction
    from ngbrain.interop.scipy import Objective
else:
    __getattr__, __dir__ = lazy_names(__name__)

__all__ = [
    "DataFunction",
    "Function",
    "Objective",
    "ObjectiveFunction",
    "function",
    "jax",
    "scipy",
    "torch",
    "umbridge",
]
