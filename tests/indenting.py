"""A rigid body that is pressed into the top of a body in the plane, or of revolution, and goes along it; and its force."""

import ngsolve as ngs
import numpy as np


class Indenter:
    """How far (m) a rigid body has gone down and along x at times (s), straight in between.

    `Friction` knows a rigid body's motion by one parameter: here `path`, the length of its way, which leads in `direction`.
    """

    def __init__(self, times, down, along=None):
        self.times, self.events = times, tuple(times[1:])
        self.ways = (down, np.zeros(len(times)) if along is None else along)
        self.down, self.along, self.path, self._right, self._up = (ngs.Parameter(0.0) for _ in range(5))
        legs = np.diff([self.ways[1], -np.asarray(self.ways[0])])
        self._lengths = np.hypot(*legs)
        self._headings = legs / np.where(self._lengths > 0, self._lengths, 1.0)

    def set(self, t):
        for way, values in zip((self.down, self.along), self.ways, strict=True):
            way.Set(np.interp(t, self.times, values))
        self.path.Set(np.interp(t, self.times, np.append(0.0, np.cumsum(self._lengths))))
        leg = max(int(np.searchsorted(self.times, t - 1e-9)) - 1, 0)  # at an event the one that ends there
        for component, value in zip((self._right, self._up), self._headings[:, leg], strict=True):
            component.Set(value)

    def travel(self, start, end):
        return sum(float(np.interp(end, self.times, w) - np.interp(start, self.times, w)) for w in self.ways)

    def direction(self, x):
        """Of the motion, whatever the point x."""
        return ngs.CF((self._right, *(0.0,) * (x.dim - 2), self._up))

    def ball(self, radius):
        """x ↦ signed distance to a ball or cylinder that touches the plane y = 0, or z = 0, at the origin at rest."""
        return lambda x: ngs.Norm(x - ngs.CF((self.along, *(0.0,) * (x.dim - 2), radius - self.down))) - radius


def forces(body):
    """Sums of the contact's nodal forces, by components (N; in plane strain per metre): minus those on the body."""
    found, field = body.contact_forces(), ngs.GridFunction(body.u.space)
    sums = []
    for i in range(body.mesh.dim):
        field.Set(ngs.CF(tuple(float(i == j) for j in range(body.mesh.dim))))
        sums.append(float(field.vec.FV().NumPy() @ found))
    return np.array(sums)
