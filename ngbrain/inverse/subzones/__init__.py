"""The inversion of wave data by overlapping subzones.

- `consensus`: A zone inverted once more, knowing what all zones found together.
- `global_check`: Whether maps that were joined hold for the body as a whole: one wave problem of it, driven as fits
  the data best.
- `invert`: The inversion of wave data zone by zone: overlapping boxes in processes of their own, then once more, each
  among its neighbours.
- `merge`: What zones answer together: joined maps and waves, the weights that they share, how far they disagree, and
  the `Inversion`.
- `partition`: Zones: overlapping boxes that wave data are cut into, and how maps of zones are joined.
- `roughness`: How rough a map at points is: ∫ |∇m|², through elements that have these values.
- `zone_result`: What comes back of a zone that was inverted, and how it is kept in a file.
"""

__all__ = ["consensus", "global_check", "invert", "merge", "partition", "roughness", "zone_result"]
