"""MR elastography: from phase images to complex displacements.

- `displacement`: From the phases of an MR scan to harmonic displacements, and how much strain and noise is in them.
"""

__all__ = ["displacement"]
