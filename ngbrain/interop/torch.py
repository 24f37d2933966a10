"""A model or an objective as a function that PyTorch differentiates: a network may be trained through the solver.

Example, a network whose output is a field of moduli::

    from ngbrain.interop.torch import function

    seen = function(model)                                   # here a `StaticModel` of one nodal field
    mu = 1e3 * torch.exp(network(nodes).squeeze(1).double()) # float64
    loss = ((seen(mu) - measured) / sigma).square().sum()
    loss.backward()                                          # one adjoint solve for each load

Get the package with: pip install "ngbrain[interop]". Derivatives: reverse and forward mode; of second order, reverse over
reverse, where the model has them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ngbrain.adjoint.reduced import Model, Reduced
from ngbrain.errors import InputError, require
from ngbrain.interop import function as functions


def function(of: Model | Reduced) -> Callable[[Any], Any]:
    """A model or an objective as a PyTorch function: θ ↦ data of a `Model`, or x ↦ J of a `Reduced`.

    It maps a float64 tensor (n,) to a float64 or complex128 one. `backward` at the last θ takes one adjoint solve for each load;
    at an earlier one, as in a sum over many θ, the model is solved again. As in PyTorch, the gradient of a complex tensor is
    ∂/∂Re + i ∂/∂Im.

    Raises `MissingExtra` without torch. The function raises `InputError` for a tensor that is not float64 on the CPU and for second
    derivatives of a model without them, and what the model raises: `SolverError` where there is no solution.
    """
    torch, f = require("torch", "interop"), functions.function(of)

    class Solved(torch.autograd.Function):  # type: ignore[misc, name-defined]
        @staticmethod
        def forward(x: Any) -> Any:
            return torch.from_numpy(f.value(x.numpy(force=True)))

        @staticmethod
        def setup_context(ctx: Any, inputs: tuple[Any], output: Any) -> None:
            ctx.save_for_backward(*inputs)
            ctx.save_for_forward(*inputs)

        @staticmethod
        def backward(ctx: Any, w: Any) -> Any:
            return Pulled.apply(*ctx.saved_tensors, w)

        @staticmethod
        def jvp(ctx: Any, direction: Any) -> Any:
            (x,) = ctx.saved_tensors
            return torch.from_numpy(f.jvp(x.numpy(force=True), direction.numpy(force=True)))

    class Pulled(torch.autograd.Function):  # type: ignore[misc, name-defined]
        @staticmethod
        def forward(x: Any, w: Any) -> Any:
            return torch.from_numpy(f.vjp(x.numpy(force=True), w.numpy(force=True)))

        @staticmethod
        def setup_context(ctx: Any, inputs: tuple[Any, Any], output: Any) -> None:
            ctx.save_for_backward(*inputs)

        @staticmethod
        @torch.autograd.function.once_differentiable  # type: ignore[untyped-decorator]
        def backward(ctx: Any, direction: Any) -> tuple[Any, Any]:
            x, w, v = (each.numpy(force=True) for each in (*ctx.saved_tensors, direction))
            return torch.from_numpy(f.hvp(x, w, v)), torch.from_numpy(f.jvp(x, v))

    def solved(x: Any) -> Any:
        if x.dtype != torch.float64:
            raise InputError("x.dtype", x.dtype, "torch.float64: x.double()")
        if x.device.type != "cpu":
            raise InputError("x.device", x.device, "the CPU, where the solver is: x.cpu()")
        return Solved.apply(x)

    return solved
