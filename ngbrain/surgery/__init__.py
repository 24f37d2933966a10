"""Blades, protocols, injury measures and the retraction job."""
