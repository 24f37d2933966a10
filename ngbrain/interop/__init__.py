"""Models and objectives as functions for PyTorch, JAX, SciPy and UM-Bridge: one module each."""
