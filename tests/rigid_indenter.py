"""A rigid body that is pressed into the top of a body in the plane, or of revolution, and goes along it; and its force."""

import ngsolve as ngs
import numpy as np


class Indenter:
    """How far (m) a rigid body has gone down and along x at times (s), straight in between; `path`: the length of its way."""

    def __init__(self, times, down, along=None):
        self.times, self.events = times, tuple(times[1:])
        self.ways = (down, np.zeros(len(times)) if along is None else along)
        self.down, self.along, self.path = (ngs.Parameter(0.0) for _ in range(3))
        self._legs = np.diff([self.ways[1], -np.asarray(self.ways[0])]).T
        self._lengths = np.linalg.norm(self._legs, axis=1)

    def set(self, t):
        for way, values in zip((self.down, self.along), self.ways, strict=True):
            way.Set(np.interp(t, self.times, values))
        self.path.Set(np.interp(t, self.times, np.append(0.0, np.cumsum(self._lengths))))

    def travel(self, start, end):
        return sum(float(np.interp(end, self.times, w) - np.interp(start, self.times, w)) for w in self.ways)

    def moves(self, x, way):
        """How far it has gone at a length of its way, whatever the point x: down and along, leg by leg."""
        gone, before = ngs.CF((0.0,) * x.dim), 0.0
        for (right, up), length in zip(self._legs, self._lengths, strict=True):
            if length:
                share = (way - before) / length
                share = ngs.IfPos(share, ngs.IfPos(share - 1, 1, share), 0)
                gone += share * ngs.CF((right, *(0.0,) * (x.dim - 2), up))
            before += length
        return gone

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
