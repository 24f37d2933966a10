"""The inverse crime: data that were computed in the elements that invert them flatter every method."""

from __future__ import annotations

import numpy as np

from ngbrain.forward.common.elements import ElementPair
from ngbrain.forward.harmonic.problem import HarmonicProblem
from ngbrain.io.waves import WaveData

ELEMENTS = {"q4": ElementPair.named("Q1"), "q4p0": ElementPair.named("Q1/L2(0)")}
CLOSE = 1e-9
"""Tolerance for equal points, relative to the size of the body."""


def is_inverse_crime(data: WaveData, body: HarmonicProblem) -> bool:
    """Whether data were computed with the elements of a body, on its vertices.

    Without noise every method then fits to the last digit. Such an error says nothing about measured waves.

    Parameters
    ----------
    data : WaveData
        Data whose `element` says how they were computed.
    body : HarmonicProblem
        The wave problem of the inversion.

    Returns
    -------
    bool
        True for an inverse crime.

    References
    ----------
    Wirgin 2004, arXiv math-ph/0401050.

    Examples
    --------
    >>> from ngbrain.inverse.phantoms.benchmark import Phantom
    >>> coarse, fine = (Phantom.from_name("CV-G", nodes).simulate_measurements() for nodes in (5, 9))
    >>> is_inverse_crime(coarse.data(), coarse.inversion().model.body), is_inverse_crime(coarse.data(), fine.inversion().model.body)
    (True, False)
    """
    if data.element is None or ELEMENTS[data.element] != body.form:
        return False
    vertices = np.array([vertex.point for vertex in body.mesh.vertices])
    if vertices.shape != data.points.shape:
        return False
    return bool(np.abs(vertices - data.points).max() <= CLOSE * np.ptp(data.points))
