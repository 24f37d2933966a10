"""Moves and swaps that improve tetrahedra and keep interfaces.

- `curving`: Meshes of tissues curved to where the labels say that tissues meet.
- `guarded_moves`: Moves of a mesh's points that never make a bad tetrahedron.
- `octree`: Tetrahedra between the middles and the corners of cubes: a body-centred lattice whose cubes are as large
  as a size field asks.
- `reconnection`: Swaps of edges and faces that replace a mesh's worst tetrahedra by better ones on the same vertices.
- `smoothing`: Moves of a mesh's vertices that make its worst tetrahedra better and keep its interfaces where they
  are.
- `snapped_lattice`: Tetrahedra whose points go to where regions meet: the part of the `lattice` mesh that knows
  shares but no names.
- `snapping`: Points of a mesh that go to where regions meet, and edges that are cut there.
- `volume_matching`: Moves of a mesh's interfaces that give its regions the volumes that they should have.
"""

__all__ = [
    "curving",
    "guarded_moves",
    "octree",
    "reconnection",
    "smoothing",
    "snapped_lattice",
    "snapping",
    "volume_matching",
]
