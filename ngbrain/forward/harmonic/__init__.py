"""Waves of one frequency: the `problem`, its `factors`, and a body's `stiffness` by elements."""

__all__ = ["factors", "problem", "stiffness"]
