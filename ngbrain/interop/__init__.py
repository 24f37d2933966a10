"""Models and objectives as differentiable functions of other libraries.

`function` (the common interface), `jax`, `scipy`, `torch`, `umbridge` (UM-Bridge over HTTP): one module for each library.
"""
