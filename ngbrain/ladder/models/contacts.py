"""Rigid bodies of a scene, as contacts of a problem: shapes by their signed distance, their way, friction."""

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
"""What counts as the way of a body that stands, in sides of the tissue."""
INSIDE = 1e-9
"""Keeps distances from an axis (m) differentiable on it."""


def travel_distance(body: Body, until: float, side: float) -> float:
    """Its largest way (m) from where it began."""
    times = until * np.append(np.arange(1000) * GOLDEN % 1, 1.0)
    far = float(np.max(np.sqrt(sum(np.square(part) for part in body.displacement(times, 1.0)))))
    return far or STANDING * side


def make_contact(
    body: Body, course: PrescribedMotion, modulus: float, far: float, rubs: bool
) -> list[RigidContact | Friction]:
    """The contact, and its friction; `modulus` (Pa) of the tissue, `far` as `way` says."""
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
        if body.shape == "cylinder" and not course.plane:  # across the section its axis is no part of the distance
            axis = [each / math.hypot(*(body.direction or ())) for each in body.direction or ()]
            square = square - sum((a * n for a, n in zip(r, axis, strict=True)), ngs.CF(0.0)) ** 2
        return ngs.sqrt(square) - (body.radius or 0.0)

    def moves(x: CoefficientFunction, now: CoefficientFunction) -> CoefficientFunction:
        return ngs.CF(tuple(part + ngs.CF(0.0) for part in gone(now)))

    met = RigidContact(body.boundary, distance, PENALTY * modulus / far, SOFTNESS * far, OFFSET_SHARE, way=parameter)
    return [met, Friction(met, body.friction, SLIP * far, moves)] if rubs and body.friction else [met]
