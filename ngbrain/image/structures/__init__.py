"""Structures of a brain: hemispheres, cerebellum, brain stem, dura, atlas regions.

- `atlas`: Label propagation from an atlas.
- `dura`: Falx and tentorium as triangulated surfaces.
- `midsurface`: Surface between the hemispheres.
- `structures`: Hemispheres, cerebellum, brain stem, deep grey matter and corpus callosum.
"""

__all__ = ["atlas", "dura", "midsurface", "structures"]
