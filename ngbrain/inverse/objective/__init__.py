"""What an inversion minimises: misfits, unknowns and their transforms, regularisers.

- `misfit`: How far predicted data are off the measured ones, in units of their noise.
- `parameters`: What is looked for: fields of a model in variables that can take any value, nodal or one for each
  label.
- `regularisation`: What is thought of a field before it is measured: smooth, of few flat parts, alike inside a label.
- `regularisers`: Regularisers by name, as `invert` offers them: what a field in these elements is thought to be
  before it is measured.
"""

__all__ = ["misfit", "parameters", "regularisation", "regularisers"]
