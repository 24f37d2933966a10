"""A model or an objective as a function that JAX differentiates, under `jit`, `grad` and `vmap`.

Example::

    import jax
    jax.config.update("jax_enable_x64", True)                # before the first array
    from ngbrain.interop.jax import function

    seen = function(model, model.theta)                      # here a `StaticModel` of one nodal field
    loss = jax.jit(jax.value_and_grad(lambda x: (((seen(1e3 * jax.numpy.exp(x)) - measured) / sigma) ** 2).sum()))

Get the package with: pip install "ngbrain[interop]". Derivatives: reverse mode, of first order.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ngbrain.adjoint.reduced import Model, Reduced
from ngbrain.errors import InputError, SolverError, require
from ngbrain.interop import function as functions

Array = np.ndarray


def function(of: Model | Reduced, start: Array) -> Callable[[Any], Any]:
    """A model or an objective as a JAX function: θ ↦ data of a `Model`, or x ↦ J of a `Reduced`.

    It maps a float64 array (n,) to a float64 or complex128 one. The model is called back for one θ after the other, also under
    `vmap`. The gradient at the last θ takes one adjoint solve for each load; at an earlier one the model is solved again. Callbacks
    must not fail: where there is no solution (`SolverError`) value and gradient are NaN. As in JAX, the gradient of a real loss
    with respect to a complex array is ∂/∂Re - i ∂/∂Im.

    Parameters
    ----------
    of : Model or Reduced
        Model or objective to differentiate.
    start : array (n,)
        A θ (or x) with a solution; solved once, as JAX needs the shape of the result beforehand.

    Returns
    -------
    callable
        It raises `InputError` for an array of another shape or type than `start`.

    Raises
    ------
    MissingExtra
        Without jax.
    InputError
        While float64 is not enabled in JAX.
    """
    jax, f = require("jax", "interop"), functions.function(of)
    if not jax.config.jax_enable_x64:
        raise InputError("jax_enable_x64", False, 'jax.config.update("jax_enable_x64", True) before the first array')
    start = np.array(start, float)
    y = f.value(start)
    given, answer = (jax.ShapeDtypeStruct(each.shape, each.dtype) for each in (start, y))

    def value(x: Any) -> Array:
        return _or_nan(lambda: f.value(np.asarray(x)), y)

    def vjp(x: Any, w: Any) -> Array:
        return _or_nan(lambda: f.vjp(np.asarray(x), np.asarray(w)), start)

    def forward(x: Any) -> tuple[Any, Any]:
        return solved(x), x

    def backward(x: Any, w: Any) -> tuple[Any]:
        return (jax.pure_callback(vjp, given, x, w.conj(), vmap_method="sequential"),)

    @jax.custom_vjp  # type: ignore[untyped-decorator]
    def solved(x: Any) -> Any:
        x = jax.numpy.asarray(x)
        if (x.shape, x.dtype) != (given.shape, given.dtype):
            raise InputError("x", f"{x.dtype} of shape {x.shape}", f"{given.dtype} of shape {given.shape}")
        return jax.pure_callback(value, answer, x, vmap_method="sequential")

    solved.defvjp(forward, backward)
    return solved


def _or_nan(solve: Callable[[], Array], like: Array) -> Array:
    try:
        return solve()
    except SolverError:
        return np.full_like(like, np.nan)
