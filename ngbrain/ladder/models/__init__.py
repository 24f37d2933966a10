"""What a model is of a scene: geometry, materials, motions, contacts, waves.

- `bodies`: What a model is of a scene: materials, supports, loads, elements; and how it is solved.
- `contacts`: Rigid bodies of a scene, as contacts of a problem: shapes by their signed distance, their way, friction.
- `geometry`: Meshes of a `Geometry` in several sizes, in space and of the plane y = 0 through its site.
- `motions`: What is prescribed of a body at any moment: formulas of place and time, rotations, and what just grows
  with the loads.
- `property_maps`: Measured maps of stiffness and of fibres, as fields over a body.
- `section`: What a plane section, or a region of interest, of a scene's body does not have.
- `waves`: What a model is of a body that is shaken: `HarmonicProblem`, and the amplitudes that are asked for.
"""

__all__ = ["bodies", "contacts", "geometry", "motions", "property_maps", "section", "waves"]
