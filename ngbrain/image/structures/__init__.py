"""Structures of a brain: hemispheres, cerebellum, brain stem, dura, atlas regions.

- `atlas`: Label propagation from an atlas.
- `dura`: Falx and tentorium as triangulated surfaces.
- `midsurface`: Surface between the hemispheres.
- `structures`: Hemispheres, cerebellum, brain stem, deep grey matter and corpus callosum.
"""

from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names

if TYPE_CHECKING:
    from ngbrain.image.structures import atlas, dura, midsurface, structures
else:
    __getattr__, __dir__ = lazy_names(__name__)

__all__ = ["atlas", "dura", "midsurface", "structures"]
