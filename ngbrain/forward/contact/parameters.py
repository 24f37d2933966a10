"""Numerical parameters of penalty contact with a rigid body, scaled by the body's travel and the tissue's initial shear modulus.

They were measured with a retractor that opens a cleft (`ngbrain.surgery.model`); other rigid bodies of a scene use them too
(`ngbrain.ladder.models.contacts`).
"""

from __future__ import annotations

PENALTY = 600.0
"""Contact stiffness, in initial shear moduli per unit of travel.

The offset of the contact (`RigidContact.share`) compensates for it. With three times this stiffness, on the mesh of the full
demonstration scene: pressure on the patch 0.5 % higher (fast scene: 0.2 % lower), deepest penetration 0.66 instead of 0.99 % of the
travel, and nearly twice as many factorisations.
"""
SOFTNESS = 0.001
"""Penetration over which the contact pressure is regularised, relative to the travel."""
OFFSET_SHARE = 0.995
"""Share of the penalty's penetration that the contact offset compensates for (θ of `RigidContact`).

The remaining penetration is 0.17 % of the travel on average in the contact zone. Its maximum, at the corners of a blade's
rounded edges that elements cannot resolve, is 1.0 % (with 4 mm elements: 0.4 and 2.1 %).
"""
SLIP = 0.01
"""Elastic slip up to full Coulomb friction, relative to the travel."""
FILM = 1e5
"""Normal stiffness of a sliding boundary in initial shear moduli per metre: a pressure of one modulus penetrates 10 µm."""
