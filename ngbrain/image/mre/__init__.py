"""MR elastography: from phase images to complex displacements.

- `displacement`: Phase unwrapping, first harmonic, removal of rigid motion, strain and its noise.
"""

__all__ = ["displacement"]
