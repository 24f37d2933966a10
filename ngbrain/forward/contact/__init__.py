"""Contact with rigid bodies.

`rigid` (contact by a signed distance function, sliding walls, self-contact), Coulomb `friction`, prescribed `motion` of rigid
bodies, numerical `parameters`, and `force_control` (prescribed force, unknown travel).
"""

__all__ = ["force_control", "friction", "motion", "parameters", "rigid"]
