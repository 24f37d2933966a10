"""MR elastography: from phase images to complex displacements.

- `displacement`: Phase unwrapping, first harmonic, removal of rigid motion, strain and its noise.
"""

from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names

if TYPE_CHECKING:
    from ngbrain.image.mre import displacement
else:
    __getattr__, __dir__ = lazy_names(__name__)

__all__ = ["displacement"]
