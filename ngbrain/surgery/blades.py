"""Retractor blades as rigid bodies: a signed distance and where it stands."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import ngsolve as ngs
from ngsolve import CoefficientFunction

from ngbrain.mesh.cleft import Cleft

INSIDE = 1e-9
"""Length (m) that keeps the derivative of a norm finite at zero."""


@dataclass(frozen=True)
class Spatula:
    """A flat blade with rounded edges, seen by the wall towards `cleft.across`, and extended behind its face.

    width         along the walls (m)
    edge_radius   of its side edges and tip (m)
    tip           height of the tip above the cleft's floor (m)
    thickness     front to back (m), for pictures and for room in the cleft: contact sees only the front face

    The face starts at the unloaded wall; `distance` takes how far it has advanced from there.
    """

    cleft: Cleft
    width: float
    edge_radius: float
    tip: float
    thickness: float

    def distance(self, advance: CoefficientFunction) -> Callable[[CoefficientFunction], CoefficientFunction]:
        """x ↦ signed distance (m) to {across ≤ face, |along| ≤ width/2, height ≥ tip} with edges rounded."""
        cleft, r = self.cleft, self.edge_radius
        target, across, along, out = (
            ngs.CF(tuple(map(float, v))) for v in (cleft.target, cleft.across, cleft.along, cleft.out)
        )

        def signed(x: CoefficientFunction) -> CoefficientFunction:
            y = x - target
            b = ngs.InnerProduct(y, along)
            inward = (
                ngs.InnerProduct(y, across) - cleft.opening / 2 - advance + r,
                ngs.sqrt(b * b + INSIDE**2) - self.width / 2 + r,
                self.tip + r - ngs.InnerProduct(y, out),
            )
            beyond = [ngs.IfPos(q, q, 0) for q in inward]
            outside = ngs.sqrt(beyond[0] ** 2 + beyond[1] ** 2 + beyond[2] ** 2 + INSIDE**2)
            deepest = _largest(_largest(inward[0], inward[1]), inward[2])
            return outside + ngs.IfPos(deepest, 0, deepest) - r

        return signed

    def patch(self, margin: float, height: float | None = None) -> CoefficientFunction:
        """1 on the unloaded wall under the face, `margin` (m) inside its edges; `height` keeps only that much from the tip."""
        x = ngs.CF((ngs.x, ngs.y, ngs.z)) - ngs.CF(tuple(map(float, self.cleft.target)))
        b = ngs.InnerProduct(x, ngs.CF(tuple(map(float, self.cleft.along))))
        c = ngs.InnerProduct(x, ngs.CF(tuple(map(float, self.cleft.out))))
        half = self.width / 2 - margin
        inside = ngs.IfPos(half * half - b * b, 1, 0) * ngs.IfPos(c - self.tip - margin, 1, 0)
        return inside if height is None else inside * ngs.IfPos(self.tip + height - c, 1, 0)


def _largest(a: CoefficientFunction, b: CoefficientFunction) -> CoefficientFunction:
    return ngs.IfPos(a - b, a, b)
