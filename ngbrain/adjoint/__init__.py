"""Derivatives and the proof that they are right."""

from ngbrain.adjoint import check

__all__ = ["check"]
