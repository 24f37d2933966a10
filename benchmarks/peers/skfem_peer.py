"""What one writes with scikit-fem: stress and tangent by hand in NumPy, MKL's Pardiso, and an undamped Newton's method."""

from __future__ import annotations

import _case as c
import numpy as np
import scipy.sparse
import skfem
from skfem.helpers import det, grad, inv, transpose

DIRECT = c.Pardiso()
ELEMENTS = {
    ("P", 3): {1: skfem.ElementTetP1, 2: skfem.ElementTetP2},
    ("Q", 3): {1: skfem.ElementHex1, 2: skfem.ElementHex2},
    ("P", 2): {1: skfem.ElementTriP1, 2: skfem.ElementTriP2, 3: skfem.ElementTriP3, 4: skfem.ElementTriP4},
}
BROKEN = {("P", 3): skfem.ElementTetDG, ("Q", 3): skfem.ElementHexDG, ("P", 2): skfem.ElementTriDG}


def bases(task: c.Task) -> tuple[skfem.Basis, skfem.Basis | None]:
    """Of the displacement and of the pressure."""
    element, dim = task.element, 2 if task.case == "cook" else 3
    offered = ELEMENTS.get((element.shape, dim), {})
    if not {element.order, element.pressure or element.order} <= set(offered) or element.pressure == 0:
        raise c.NotOffered(f"{element.key} in {dim}-D")
    line = np.linspace(0, 1, task.n + 1)
    if dim == 2:
        mesh = skfem.MeshTri.init_tensor(line, line)
        mesh = type(mesh)(np.array(c.cook_map(*mesh.p)), mesh.t)
    else:
        kind = skfem.MeshHex if element.shape == "Q" else skfem.MeshTet
        mesh = kind.init_tensor(*[c.L * line] * 3)
    degree = 2 * element.order + (1 if element.shape == "Q" else 0)
    motion = skfem.Basis(mesh, skfem.ElementVector(offered[element.order]()), intorder=degree)
    if element.pressure is None:
        return motion, None
    inner = offered[element.pressure]()
    return motion, motion.with_element(inner if element.continuous else BROKEN[element.shape, dim](inner))


class Point:
    """Stress and tangent at every quadrature point of a state; the pressure is given or follows the volume."""

    def __init__(self, cook: bool, H: np.ndarray, p: np.ndarray | None) -> None:
        bulk = c.COOK_K if cook else c.K
        self.F = F = H + np.eye(len(H))[:, :, None, None]
        self.J, self.G = det(F), transpose(inv(F))
        self.swelling, slope = (np.log(self.J), 1.0) if cook else (self.J - 1, self.J)
        self.pressure, self.own = (bulk * self.swelling, bulk) if p is None else (p, 0.0)
        self.cook, self.I1 = cook, np.einsum("ij...,ij...->...", F, F)
        self.mu = c.COOK_MU if cook else c.MU * self.J ** (-2 / 3)
        self.jvp = slope * self.G  # the derivative of the swelling
        self.P = self.mu * (F - (self.G if cook else self.I1 / 3 * self.G)) + self.pressure * self.jvp
        self.last: tuple = (None, None)

    def tangent(self, dF: np.ndarray) -> np.ndarray:
        """The stress's change; kept for the next test function."""
        if self.last[0] is dF:
            return self.last[1]
        F, G, mu = self.F, self.G, self.mu
        along = np.einsum("ij...,ij...->...", G, dF)
        turned = -np.einsum("il...,kl...,kj...->ij...", G, dF, G, optimize=True)  # the change of G
        if self.cook:
            dP = mu * (dF - turned) + self.pressure * turned
        else:
            stretch = np.einsum("ij...,ij...->...", F, dF)
            dP = mu * (dF - 2 / 3 * (along * F + stretch * G) + (2 / 9 * self.I1 * along) * G - self.I1 / 3 * turned)
            dP = dP + self.pressure * self.J * (along * G + turned)
        if self.own:
            dP = dP + self.own * np.einsum("ij...,ij...->...", self.jvp, dF) * self.jvp
        self.last = (dF, dP)
        return dP


class Assembled:
    """Residual and matrix of a case, and what is prescribed."""

    def __init__(self, task: c.Task) -> None:
        self.cook = task.case == "cook"
        self.bulk = c.COOK_K if self.cook else c.K
        self.motion, self.pressure = motion, pressure = bases(task)
        self.split = motion.N
        self.ndof = int(motion.N + (pressure.N if pressure else 0))
        self.load, self.jump, self.weight = np.zeros(self.ndof), np.zeros(self.ndof), np.zeros(self.ndof)
        if self.cook:
            fixed = [motion.get_dofs(lambda x: np.isclose(x[0], 0)).all()]
            right = motion.boundary(motion.mesh.facets_satisfying(lambda x: np.isclose(x[0], 48)))
            self.load[: motion.N] = skfem.LinearForm(lambda v, w: c.TRACTION * v[1]).assemble(right)
        else:
            top = motion.get_dofs(lambda x: np.isclose(x[2], c.L))
            fixed = [motion.get_dofs(lambda x: np.isclose(x[2], 0)).all(), top.all()]
            moved = top.all(["u^3"])
            x, y, _ = motion.doflocs[:, moved] * np.pi / c.L
            self.weight[moved] = np.cos(x) * np.cos(y) if task.case == "smooth" else 1.0
            self.jump = (c.WAVE if task.case == "smooth" else c.PRESS) * self.weight
            if task.case == "smooth":
                for i in (0, 1):
                    wall = motion.get_dofs(lambda x, i=i: np.isclose(x[i], 0) | np.isclose(x[i], c.L))
                    fixed.append(wall.all([f"u^{i + 1}"]))
        self.free = np.ones(self.ndof, bool)
        self.free[np.concatenate(fixed)] = False

    def point(self, x: np.ndarray) -> Point:
        """The state at the quadrature points."""
        p = None if self.pressure is None else np.asarray(self.pressure.interpolate(x[self.split :]))
        return Point(self.cook, self.motion.interpolate(x[: self.split]).grad, p)

    def residual(self, point: Point, load: float) -> np.ndarray:
        """Forces without balance, then volumes."""
        force = skfem.LinearForm(lambda v, w: np.einsum("ij...,ij...->...", point.P, grad(v)))
        parts = [force.assemble(self.motion)]
        if self.pressure is not None:
            volume = skfem.LinearForm(lambda q, w: q * (point.swelling - point.pressure / self.bulk))
            parts.append(volume.assemble(self.pressure))
        return np.concatenate(parts) - load * self.load

    def matrix(self, point: Point) -> scipy.sparse.csr_matrix:
        """The residual's derivative."""
        inner = "ij...,ij...->..."
        A = skfem.BilinearForm(lambda u, v, w: np.einsum(inner, point.tangent(u.grad), grad(v))).assemble(self.motion)
        if self.pressure is not None:
            coupling = skfem.BilinearForm(lambda u, q, w: q * np.einsum(inner, point.jvp, grad(u)))
            compliance = skfem.BilinearForm(lambda p, q, w: -p * q / self.bulk)
            B = coupling.assemble(self.motion, self.pressure)
            A = scipy.sparse.bmat([[A, B.T], [B, compliance.assemble(self.pressure)]])
        return A.tocsr()

    def norms(self, residual: np.ndarray) -> tuple[float, float]:
        """Of the residual where nothing is prescribed, as a force, and of the reactions."""
        scaled = residual.copy()
        scaled[self.split :] *= self.bulk / (48 if self.cook else c.L)
        return float(np.linalg.norm(scaled[self.free])), float(np.linalg.norm(scaled[~self.free]))


def solve(task: c.Task) -> dict:
    """Undamped Newton in equal load steps; a step's motion enters through its first iteration."""
    with task.phase("compile"):  # the tables of shape functions
        problem = Assembled(task)
    DIRECT.task = task
    x, free, newton = np.zeros(problem.ndof), problem.free, 0
    with task.phase("assemble"):
        point = problem.point(x)
    for step in range(1, task.steps + 1):
        with task.phase("assemble"):
            residual = problem.residual(point, step / task.steps)
        for iteration in range(c.MAX_NEWTON):
            with task.phase("assemble"):
                A = problem.matrix(point)
                change = problem.jump / task.steps if iteration == 0 else np.zeros(problem.ndof)
                rhs = -residual - A @ change
                A = A[free][:, free].tocsr()
            change[free] += DIRECT(A, rhs[free])
            x, newton = x + change, newton + 1
            with task.phase("assemble"):
                point = problem.point(x)
                residual = problem.residual(point, step / task.steps)
            if c.check(*problem.norms(residual), newton=newton, ndof=problem.ndof):
                break
        else:
            raise c.Failed(f"Newton took {c.MAX_NEWTON} iterations", newton=newton, ndof=problem.ndof)
    if problem.cook:
        corner = problem.motion.get_dofs(lambda x: np.isclose(x[0], c.CORNER[0]))
        rows = corner.all(["u^2"])
        value = x[rows[np.argmax(problem.motion.doflocs[1, rows])]]
    else:
        value = residual @ problem.weight
    return {"value": float(value), "ndof": problem.ndof, "newton": newton}


if __name__ == "__main__":
    np.seterr(all="ignore")
    c.main("scikit-fem", solve, {"scikit-fem": skfem.__version__, "numpy": np.__version__, **DIRECT.versions})
