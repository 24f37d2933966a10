"""What one writes with scikit-fem for a shear wave in a strip: forms in NumPy, SciPy's SuperLU. Prints one record.

python skfem_waves.py KL XI N ORDER
"""

import json
import sys
import time

import numpy as np
import scipy.sparse.linalg
import skfem
from skfem.helpers import ddot, div, dot, sym_grad, trace

turns, xi, n, order = float(sys.argv[1]), float(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4])
omega, rho, length, bulk = 2 * np.pi * 50, 1000.0, 0.1, 1e5
G = rho * (omega * length / turns) ** 2 * (1 + 2j * xi)
elements = {1: skfem.ElementTriP1, 2: skfem.ElementTriP2, 4: skfem.ElementTriP4}

start = time.process_time()
mesh = skfem.MeshTri.init_tensor(np.linspace(0, length, n + 1), np.linspace(0, length / 4, n // 4 + 1))
basis = skfem.Basis(mesh, skfem.ElementVector(elements[order]()), intorder=2 * order)


@skfem.BilinearForm(dtype=np.complex128)
def waves(u, v, w):
    e, f = sym_grad(u), sym_grad(v)
    return 2 * G * (ddot(e, f) - div(u) * trace(f) / 3) + bulk * div(u) * div(v) - rho * omega**2 * dot(u, v)


A = waves.assemble(basis)
x = np.zeros(basis.N, complex)
ends = basis.get_dofs(lambda p: (p[0] < 1e-12) | (p[0] > length - 1e-12))
k = omega * np.sqrt(rho / G + 0j)
locations = basis.doflocs[0]
sides = basis.get_dofs(lambda p: (p[1] < 1e-12) | (p[1] > length / 4 - 1e-12)).all(["u^1"])
held = np.union1d(ends.all(), sides)
driven = np.array([d for d in ends.all(["u^2"]) if locations[d] < 1e-12])
x[driven] = 1e-3
x = skfem.solve(*skfem.condense(A, x=x, D=held), solver=lambda A, b: scipy.sparse.linalg.spsolve(A.tocsc(), b))
cpu = time.process_time() - start


@skfem.Functional(dtype=np.complex128)
def off(w):
    exact = 1e-3 * np.sin(k * (length - w.x[0])) / np.sin(k * length)
    return np.abs(w["u"][0]) ** 2 + np.abs(w["u"][1] - exact) ** 2


@skfem.Functional
def whole(w):
    return np.abs(1e-3 * np.sin(k * (length - w.x[0])) / np.sin(k * length)) ** 2


fine = basis.with_elements(np.arange(mesh.nelements))
error = float(np.sqrt(off.assemble(fine, u=fine.interpolate(x)).real / whole.assemble(fine)))
print(json.dumps({"ndof": int(basis.N), "error": error, "cpu_s": cpu, "versions": {"scikit-fem": skfem.__version__}}))
