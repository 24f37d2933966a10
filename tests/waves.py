"""Waves in closed form, and how far a solution is from them."""

import ngsolve as ngs
import numpy as np
from ngsolve.meshes import MakeStructured2DMesh, MakeStructured3DMesh

from ngbrain.materials import TransverselyIsotropic


def number(G, omega, rho=1000.0):
    """k (1/m) of e^{i(ωt - kx)}, Im k ≤ 0."""
    return omega * np.sqrt(rho / np.asarray(G, complex))


def square(n, side=0.05, quads=False):
    """n × n squares, cut in two unless `quads`."""
    return MakeStructured2DMesh(quads=quads, nx=n, ny=n, mapping=lambda x, y: (side * x, side * y))


def strip(n, length=0.05, height=0.002, quads=True):
    """n elements one behind the other: between rollers on its long sides, waves in it have one dimension."""
    return MakeStructured2DMesh(quads=quads, nx=n, ny=1, mapping=lambda x, y: (length * x, height * y))


def cube(n, side=0.04):
    """n³ cubes of tetrahedra."""
    return MakeStructured3DMesh(hexes=False, nx=n, ny=n, nz=n, mapping=lambda x, y, z: (side * x, side * y, side * z))


def error(found, exact, mesh, weight=1.0):
    """‖found - exact‖ / ‖exact‖ in L2."""

    def size(f):
        return sum((f[i] * ngs.Conj(f[i])).real for i in range(f.dim)) * weight

    off, whole = (ngs.Integrate(size(f), mesh, order=14) for f in (found - exact, exact))
    return float(np.sqrt(off / whole))


def displacement(body, number=0):
    """u of a solved wave."""
    u = body.solve()[number]
    return u.components[0] if body.mixed else u


def plane_wave(law, bulk, rho, omega, direction, which, dim):
    """e^{-ik n·x} times its polarisation, from the acoustic tensor of a law: which = 0 the slowest wave.

    The tensor comes from the energy at single strains, by numpy alone for the two laws written out here.
    """
    n = np.zeros(3)
    n[: len(direction)] = direction
    n /= np.linalg.norm(n)
    C = stiffness(law, bulk)
    acoustic = np.einsum("ijkl,j,l->ik", C, n, n)[:dim, :dim]
    values, vectors = np.linalg.eig(acoustic)
    order = np.argsort(values.real)
    value, vector = values[order[which]], vectors[:, order[which]]
    k = omega * np.sqrt(rho / value)
    k = -k if k.imag > 0 else k
    x = (ngs.x, ngs.y, ngs.z)[:dim]
    phase = sum(complex(k * n[i]) * x[i] for i in range(dim))
    wave = ngs.exp(-1j * phase)
    return ngs.CF(tuple(complex(v) * wave for v in vector)), value


def stiffness(law, bulk):
    """C_ijkl of `Shearing` or of `TransverselyIsotropic` with numbers, and a bulk modulus."""
    d = np.eye(3)
    same = (np.einsum("ik,jl->ijkl", d, d) + np.einsum("il,jk->ijkl", d, d)) / 2
    volume = np.einsum("ij,kl->ijkl", d, d)
    C = 2 * law.mu * (same - volume / 3) + bulk * volume
    if isinstance(law, TransverselyIsotropic):
        a = np.zeros(3)
        a[: len(law.fibre)] = law.fibre
        a /= np.linalg.norm(a)
        M = np.outer(a, a)
        # |εa|² as a form of the symmetric ε, less (a·εa)²
        pairs = [np.einsum("ik,jl->ijkl", d, M), np.einsum("il,jk->ijkl", d, M)]
        pairs += [np.einsum("jk,il->ijkl", d, M), np.einsum("jl,ik->ijkl", d, M)]
        sheared = sum(pairs) / 4 - np.einsum("ij,kl->ijkl", M, M)
        dev = M - d / 3
        C = C + 4 * law.mu * (law.phi * sheared + law.zeta * np.einsum("ij,kl->ijkl", dev, dev))
    return C
