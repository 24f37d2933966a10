"""Rigid bodies that tissue meets.

`rigid` (contact with a signed distance function, sliding walls, self-contact), Coulomb `friction`, the `motion` of rigid bodies,
`force_control`, where their force is given and not their way, and the numerical `parameters` of contact.
"""

__all__ = ["force_control", "friction", "motion", "parameters", "rigid"]
