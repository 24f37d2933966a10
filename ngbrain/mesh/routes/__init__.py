"""Ways from labels to a volume mesh, by name.

- `cleft_head`: A head of any shape, opened by a cleft: from the smooth outlines of brain and ventricles to
  tetrahedra.
- `conforming`: Tetrahedra of tissues that conform where tissues meet, straight from a map of labels, as fine as a
  size field asks.
- `craniotomy`: An opening in a head by any route: a cleft with plane walls under a craniotomy.
- `hull`: The smallest model of a head: its surface, ventricles and lesions as conforming surfaces, tissue as a field
  inside.
- `lattice`: Labels to tetrahedra by a lattice that is snapped onto the interfaces: no surface is made, any labels
  will do.
- `registry`: From labels to a mesh by one of several routes, and what came of it.
"""

__all__ = ["cleft_head", "conforming", "craniotomy", "hull", "lattice", "registry"]
