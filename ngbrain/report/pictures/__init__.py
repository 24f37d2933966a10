"""The pictures of the pages.

- `animation`: Protocols side by side on the same slice: each at its peak, and all of them at equal times as a viewer
  shows them.
- `cut_plane`: The displaced tissue and the blade on the plane of approach and push, through the target.
- `figures`: The pictures of a retraction report; each function gives the bytes of a PNG.
- `frame`: A protocol's tissue and blade at one time, as the pictures need them.
- `planes`: Values at points as pictures: images on grids, triangles between scattered points; in space three middle
  planes.
- `slices`: Three slices of a scan through the target: tissue labels, and the mesh that was made of them.
- `style`: What the pictures share: sizes, colours, the strain scale, names of directions.
- `timeline`: A protocol's run as the pictures need it: its tissue at any time.
- `tool`: Tools as they are drawn, from the distance that contact sees: cut through the middle, and as solids.
- `volume`: The head in three dimensions: whole, and cut open at the site.
"""

__all__ = ["animation", "cut_plane", "figures", "frame", "planes", "slices", "style", "timeline", "tool", "volume"]
