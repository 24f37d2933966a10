"""Nonlinear solvers; they know vectors and callables only."""
