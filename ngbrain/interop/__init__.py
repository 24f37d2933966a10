"""Models and objectives as differentiable functions of other libraries, one module each.

- `function`: the interface that all of them adapt.
- `jax`: JAX, with derivatives of both directions.
- `scipy`: objectives for `scipy.optimize`.
- `torch`: PyTorch autograd.
- `umbridge`: UM-Bridge, models over HTTP.
"""

__all__ = ["function", "jax", "scipy", "torch", "umbridge"]
