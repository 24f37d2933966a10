"""Rigid bodies that tissue meets.

`rigid` (contact with a signed distance function, sliding walls, self-contact), Coulomb `friction`, the `motion` of rigid bodies,
and `force_control`, where their force is given and not their way.
"""

__all__ = ["force_control", "friction", "motion", "rigid"]
