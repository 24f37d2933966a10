"""Equilibrium: `load_path` to it, and whether it is stable (`stability`)."""

__all__ = ["load_path", "stability"]
