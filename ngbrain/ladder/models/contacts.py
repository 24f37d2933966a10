"""Rigid bodies of a scene as contacts of a problem: signed distance, motion, friction."""

from __future__ import annotations

import math
from typing import Any

import ngsolve as ngs
import numpy as np
from ngsolve import CoefficientFunction

from ngbrain.forward.contact.friction import Friction
from ngbrain.forward.contact.parameters import OFFSET_SHARE, PENALTY, SLIP, SOFTNESS
from ngbrain.forward.contact.rigid import RigidContact
from ngbrain.ladder.models.motions import FIELDS, GOLDEN, PrescribedMotion
from ngbrain.scene.contacts import Contact as Body

STANDING = 0.01
"""Assumed travel of a rigid body at rest, relative to the side of the tissue."""
INSIDE = 1e-9
"""Keeps distances from an axis (m) differentiable on it."""


def travel_distance(body: Body, until: float, side: float) -> float:
    """Largest displacement (m) of a rigid body.

    Parameters
    ----------
    body : scene.Contact
    until : float
        End (s).
    side : float
        Side (m) of the tissue, for a body at rest.

    Returns
    -------
    float
    """
    times = until * np.append(np.arange(1000) * GOLDEN % 1, 1.0)
    far = float(np.max(np.sqrt(sum(np.square(part) for part in body.displacement(times, 1.0)))))
    return far or STANDING * side


def make_contact(
    body: Body, course: PrescribedMotion, modulus: float, far: float, rubs: bool
) -> list[RigidContact | Friction]:
    """The contact of a rigid body, and its friction.

    Parameters
    ----------
    body : scene.Contact
    course : PrescribedMotion
    modulus : float
        Initial shear modulus (Pa) of the tissue.
    far : float
        Travel (m), see `travel_distance`.
    rubs : bool
        Whether friction is included.

    Returns
    -------
    list
    """
    parameter = course.time if body.is_timed else course.growth

    def gone(now: Any) -> list[CoefficientFunction]:
        parts = body.displacement(now, course.growth, FIELDS) if body.is_timed else body.displacement(0.0, now, FIELDS)
        return [parts[i] for i in course.axes]

    def distance(x: CoefficientFunction) -> CoefficientFunction:
        moved = gone(parameter)
        r = [x[i] - body.point[k] - moved[i] for i, k in enumerate(course.axes)]
        if body.shape == "plane":
            normal = [each / math.hypot(*(body.direction or ())) for each in body.direction or ()]
            return sum((a * normal[k] for a, k in zip(r, course.axes, strict=True)), ngs.CF(0.0))
        square = sum((a * a for a in r), ngs.CF(INSIDE**2))
        if body.shape == "cylinder" and not course.plane:  # normal to the section the axis does not enter the distance
            axis = [each / math.hypot(*(body.direction or ())) for each in body.direction or ()]
            square = square - sum((a * n for a, n in zip(r, axis, strict=True)), ngs.CF(0.0)) ** 2
        return ngs.sqrt(square) - (body.radius or 0.0)

    def moves(x: CoefficientFunction, now: CoefficientFunction) -> CoefficientFunction:
        return ngs.CF(tuple(part + ngs.CF(0.0) for part in gone(now)))

    met = RigidContact(body.boundary, distance, PENALTY * modulus / far, SOFTNESS * far, OFFSET_SHARE, travel=parameter)
    return [met, Friction(met, body.friction, SLIP * far, moves)] if rubs and body.friction else [met]
