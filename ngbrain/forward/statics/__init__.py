"""Equilibrium: `load_path` (load stepping) and `stability` (smallest eigenvalue, compressed and creased fractions)."""

__all__ = ["load_path", "stability"]
