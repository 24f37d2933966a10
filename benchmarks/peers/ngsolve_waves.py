"""What one writes with NGSolve for a shear wave in a strip, its default solver. Prints one record.

python ngsolve_waves.py KL XI N ORDER
"""

import json
import sys
import time

import ngsolve as ngs
import numpy as np
from ngsolve.meshes import MakeStructured2DMesh

ngs.ngsglobals.msg_level = 0
ngs.SetNumThreads(1)
turns, xi, n, order = float(sys.argv[1]), float(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4])
omega, rho, length, bulk = 2 * np.pi * 50, 1000.0, 0.1, 1e5
G = complex(rho * (omega * length / turns) ** 2 * (1 + 2j * xi))

start = time.process_time()
mesh = MakeStructured2DMesh(quads=False, nx=n, ny=n // 4, mapping=lambda x, y: (length * x, length / 4 * y))
fes = ngs.VectorH1(mesh, order=order, complex=True, dirichlety="left|right", dirichletx=".*")
u, v = fes.TnT()
e, f = ngs.Sym(ngs.Grad(u)), ngs.Sym(ngs.Grad(v))
A = ngs.BilinearForm(fes, symmetric=True)
shear = 2 * G * (ngs.InnerProduct(e, f) - ngs.Trace(e) * ngs.Trace(f) / 3)
A += (shear + bulk * ngs.Trace(e) * ngs.Trace(f) - rho * omega**2 * u * v) * ngs.dx
A.Assemble()
gfu = ngs.GridFunction(fes)
gfu.Set((0, 1e-3), definedon=mesh.Boundaries("left"))
residual = (-A.mat * gfu.vec).Evaluate()
gfu.vec.data += A.mat.Inverse(fes.FreeDofs()) * residual
cpu = time.process_time() - start

k = omega * np.sqrt(rho / G)
exact = ngs.CF((0, 1e-3 / np.sin(k * length) * ngs.sin(complex(k) * (length - ngs.x))))
off, whole = (ngs.Integrate(ngs.Norm(f) ** 2, mesh, order=2 * order + 4) for f in (gfu - exact, exact))
record = {"ndof": fes.ndof, "error": float(np.sqrt(off / whole)), "cpu_s": cpu}
print(json.dumps(record | {"versions": {"ngsolve": ngs.__version__}}))
