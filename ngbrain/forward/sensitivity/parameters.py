"""Parameters that models accept, and their blocks."""

from __future__ import annotations

from typing import TypeAlias

import ngsolve as ngs

from ngbrain.errors import InputError
from ngbrain.forward.sensitivity.node_positions import NodePositions
from ngbrain.forward.sensitivity.parameter_blocks import Field, ParameterBlock, PrescribedDisplacement, Scalar

Parameter: TypeAlias = ngs.GridFunction | ngs.Parameter | PrescribedDisplacement | NodePositions


def parameter_block(name: str, of: Parameter) -> ParameterBlock:
    """The block of a GridFunction or an `ngs.Parameter`; a block is returned as it is.

    Parameters
    ----------
    name : str
        Name of the parameter, for messages.
    of : GridFunction, Parameter, PrescribedDisplacement or NodePositions
        The parameter.

    Returns
    -------
    ParameterBlock

    Raises
    ------
    InputError
        For a complex GridFunction and for anything else.
    """
    if isinstance(of, ngs.GridFunction):
        if of.space.is_complex:
            raise InputError(f"parameters.{name}", "complex", "a real field")
        return Field(of)
    if isinstance(of, ngs.Parameter):
        return Scalar(of)
    if not isinstance(of, (PrescribedDisplacement, NodePositions)):
        wanted = "a GridFunction, a Parameter, PrescribedDisplacement(body, boundary) or NodePositions(mesh)"
        raise InputError(f"parameters.{name}", type(of).__name__, wanted)
    return of
