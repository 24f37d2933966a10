"""Equilibrium: `load_path` (load stepping) and `stability` (smallest eigenvalue, compressed and creased fractions)."""

from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names

if TYPE_CHECKING:
    from ngbrain.forward.statics import load_path, stability
else:
    __getattr__, __dir__ = lazy_names(__name__)

__all__ = ["load_path", "stability"]
