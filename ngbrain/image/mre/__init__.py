"""MR elastography: from phase images to complex displacements, and their strain.

- `displacement`: Phase unwrapping, first harmonic, removal of rigid motion.
- `strain`: Octahedral shear strain and its signal-to-noise ratio.
"""

from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names

if TYPE_CHECKING:
    from ngbrain.image.mre import displacement, strain
else:
    __getattr__, __dir__ = lazy_names(__name__)

__all__ = ["displacement", "strain"]
