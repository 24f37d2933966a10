"""A model or an objective for the sampling packages that speak UM-Bridge, over HTTP.

Example, in one process::

    import umbridge
    from ngbrain.interop.umbridge import model

    umbridge.serve_models([model(reduced, inversion.start, "elastography")], 4242)      # to whoever can reach the port

and in another one::

    served = umbridge.HTTPModel("http://127.0.0.1:4242", "elastography")
    ((value,),) = served([x])
    gradient = served.gradient(0, 0, [x], [1.0])

Get the package with: pip install "ngbrain[interop]". Source: Seelinger et al. 2023, UM-Bridge, 10.21105/joss.04748.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from ngbrain.adjoint.reduced import Model, Reduced
from ngbrain.errors import InputError, NgbrainError, SolverError, require
from ngbrain.interop.function import DataFunction, Function, ObjectiveFunction

Array = np.ndarray
Numbers = list[float]
Config = dict[str, Any] | None
BEYOND = 1e30
"""Value of J where there is no solution, as JSON has no infinity."""


def model(of: Model | Reduced, start: Array, name: str = "ngbrain") -> Any:
    """An `umbridge.Model` of a forward model or an objective: one input vector, θ or x, and one output vector, data or J.

    Complex data are their real parts, followed by their imaginary parts; arrays are raveled. `apply_hessian` is supported by a
    `Model` whose linearised state has `hvp`, and by a `Reduced`: the full Hessian of such a model, else the Gauss-Newton matrix.
    Where there is no solution J is `BEYOND`, with zero gradient; data have no value: the client raises an exception with the
    name and the message of the error, as for wrong input, and the server goes on.

    Parameters
    ----------
    of : Model or Reduced
        Model or objective to serve.
    start : array (n,)
        A θ (or x) with a solution; solved once, as the size of the output has to be known.
    name : str
        Name of the model on the server.

    Returns
    -------
    umbridge.Model

    Raises
    ------
    MissingExtra
        Without umbridge.
    """
    umbridge = require("umbridge", "interop")
    f: Function = _PenalisedObjective(of) if isinstance(of, Reduced) else DataFunction(of)
    start = np.array(start, float)
    y = f.value(start)
    try:
        f.hvp(start, y, start)
        curved = True
    except InputError:
        curved = False

    class Served(umbridge.Model):  # type: ignore[misc, name-defined]
        def get_input_sizes(self, config: Config = None) -> list[int]:
            return [len(start)]

        def get_output_sizes(self, config: Config = None) -> list[int]:
            return [len(_real(y))]

        def __call__(self, parameters: list[Numbers], config: Config = None) -> list[Numbers]:
            with _told():
                return [_real(f.value(np.array(parameters[0])))]

        def gradient(
            self, out_wrt: int, in_wrt: int, parameters: list[Numbers], sens: Numbers, config: Config = None
        ) -> Numbers:
            with _told():
                return _real(f.vjp(np.array(parameters[0]), _like(y, sens)))

        def apply_jacobian(
            self, out_wrt: int, in_wrt: int, parameters: list[Numbers], vec: Numbers, config: Config = None
        ) -> Numbers:
            with _told():
                return _real(f.jvp(np.array(parameters[0]), np.array(vec)))

        def apply_hessian(
            self,
            out_wrt: int,
            in_wrt1: int,
            in_wrt2: int,
            parameters: list[Numbers],
            sens: Numbers,
            vec: Numbers,
            config: Config = None,
        ) -> Numbers:
            with _told():
                return _real(f.hvp(np.array(parameters[0]), _like(y, sens), np.array(vec)))

        def supports_evaluate(self) -> bool:
            return True

        supports_gradient = supports_apply_jacobian = supports_evaluate

        def supports_apply_hessian(self) -> bool:
            return curved

    return Served(name)


class _PenalisedObjective(ObjectiveFunction):
    """Objective with the value `BEYOND` where there is no solution, and the Gauss-Newton matrix where there is no Hessian."""

    def value(self, x: Array) -> Array:
        try:
            return super().value(x)
        except SolverError:
            return np.array(BEYOND)

    def vjp(self, x: Array, w: Array | float) -> Array:
        try:
            return super().vjp(x, w)
        except SolverError:
            return np.zeros(len(x))

    def hvp(self, x: Array, w: Array, direction: Array) -> Array:
        try:
            return super().hvp(x, w, direction)
        except InputError:
            return w * self.product(x, direction)


@contextmanager
def _told() -> Iterator[None]:
    """Context whose exceptions reach the client as protocol errors, in place of a page that is not JSON."""
    try:
        yield
    except NgbrainError as error:
        text = json.dumps({"error": {"type": type(error).__name__, "message": str(error)}})
        web = require("aiohttp.web", "interop")
        raise web.HTTPInternalServerError(text=text, content_type="application/json") from error


def _real(y: Array) -> Numbers:
    """Real array: all real parts, then all imaginary parts."""
    parts = (y.real, y.imag) if np.iscomplexobj(y) else (y,)
    return np.concatenate([part.ravel() for part in parts]).tolist()


def _like(y: Array, numbers: Numbers) -> Array:
    """Inverse of `_real`, with the shape of y."""
    w = np.array(numbers)
    if np.iscomplexobj(y):
        w = w[: y.size] + 1j * w[y.size :]
    return w.reshape(y.shape)
