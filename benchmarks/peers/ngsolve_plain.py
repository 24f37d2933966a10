"""What one writes with NGSolve alone: its energies, condensation and sparse Cholesky, and an undamped Newton's method."""

from __future__ import annotations

from contextlib import nullcontext
from math import pi

import _case as c
import ngsolve as ngs
import numpy as np
from ngsolve.meshes import MakeStructured2DMesh, MakeStructured3DMesh

ngs.SetNumThreads(int(c.THREADS))
ngs.ngsglobals.msg_level = 0


def domain(task: c.Task) -> ngs.Mesh:
    """The mesh of a case."""
    n, quads = task.n, task.element.shape == "Q"
    if task.case != "cook":
        return MakeStructured3DMesh(quads, nx=n, ny=n, nz=n, mapping=lambda *x: tuple(c.L * xi for xi in x))
    mesh = MakeStructured2DMesh(quads, n, n, mapping=c.cook_map, flip_triangles=True)
    for _ in range(task.corners):
        corners = {mesh(*at).nr for at in c.CORNERS}
        for element in mesh.Elements():
            mesh.SetRefinementFlag(element, element.nr in corners)
        mesh.Refine()
    return mesh


def wave(case: str) -> ngs.CoefficientFunction:
    """The top's motion over its largest."""
    return ngs.cos(pi * ngs.x / c.L) * ngs.cos(pi * ngs.y / c.L) if case == "smooth" else ngs.CF(1)


class Problem:
    """A case's space, energy and prescribed motion."""

    def __init__(self, task: c.Task) -> None:
        element = task.element
        self.cook, self.load = task.case == "cook", ngs.Parameter(0)
        self.mesh, top = domain(task), None
        if self.cook:
            fixed = {"dirichlet": "left"}
        else:
            fixed, top = {"dirichlet": "bottom|top"}, self.mesh.Boundaries("top")
            if task.case == "smooth":
                fixed = {"dirichletx": "bottom|top|back|front", "dirichlety": "bottom|top|left|right"}
                fixed["dirichletz"] = "bottom|top"
        self.V = ngs.VectorH1(self.mesh, order=element.order, **fixed)
        self.X, u, p = self.V, self.V.TrialFunction(), None
        if element.pressure is not None:
            kind = ngs.H1 if element.continuous else ngs.L2
            self.X = self.V * kind(self.mesh, order=element.pressure)
            u, p = self.X.TrialFunction()
        self.state = ngs.GridFunction(self.X)
        self.u = self.state.components[0] if p is not None else self.state
        self.form = ngs.BilinearForm(self.X, symmetric=True, condense=True)
        self.form += ngs.Variation(self.density(u, p).Compile() * ngs.dx)
        if self.cook:
            self.form += ngs.Variation(-self.load * c.TRACTION * u[1] * ngs.ds("right"))
        self.free = np.fromiter(self.X.FreeDofs(), bool, self.X.ndof)
        self.motion = ngs.GridFunction(self.X)  # at full load
        self.weight = ngs.GridFunction(self.V)  # of the force
        if top is not None:
            self.weight.Set(ngs.CF((0, 0, wave(task.case))), definedon=top, dual=True)
            moved = self.motion.components[0] if p is not None else self.motion
            moved.vec.data = (c.WAVE if task.case == "smooth" else c.PRESS) * self.weight.vec

    def density(self, u: ngs.CoefficientFunction, p: ngs.CoefficientFunction | None) -> ngs.CoefficientFunction:
        """The case's energy."""
        F = ngs.Id(u.dim) + ngs.Grad(u)
        J, I1 = ngs.Det(F), ngs.InnerProduct(F, F)
        if self.cook:
            bulk, shear, swelling = c.COOK_K, c.COOK_MU / 2 * (I1 + 1 - 3 - 2 * ngs.log(J)), ngs.log(J)
        else:
            bulk, shear, swelling = c.K, c.MU / 2 * (J ** (-2 / 3) * I1 - 3), J - 1
        return shear + (bulk / 2 * swelling**2 if p is None else p * swelling - p**2 / (2 * bulk))

    def norms(self, residual: ngs.BaseVector) -> tuple[float, float]:
        """Of the residual where nothing is prescribed, as a force, and of the reactions."""
        array = residual.FV().NumPy().copy()
        array[self.V.ndof :] *= c.COOK_K / 48 if self.cook else c.K / c.L
        return float(np.linalg.norm(array[self.free])), float(np.linalg.norm(array[~self.free]))


def solve(task: c.Task) -> dict:
    """Undamped Newton in equal load steps; a step's motion enters through its first iteration."""
    problem = Problem(task)
    form, state = problem.form, problem.state
    free = problem.X.FreeDofs(True)
    residual, rhs, change, minus = (state.vec.CreateVector() for _ in range(4))
    inverse, newton = None, 0
    for step in range(1, task.steps + 1):
        problem.load.Set(step / task.steps)
        change[:] = 0
        jump = (1 / task.steps) * problem.motion.vec
        form.Apply(state.vec, residual)
        for iteration in range(c.MAX_NEWTON):
            with task.phase("assemble"):
                form.AssembleLinearization(state.vec)
            with task.phase("factor"):
                if inverse is None:
                    inverse = form.mat.Inverse(free, inverse="sparsecholesky")
                else:
                    inverse.Update()
            with task.phase("solve"):
                minus.data = -1 * residual
                rhs.data = minus + form.harmonic_extension_trans * minus
                if iteration == 0:
                    rhs.data -= form.mat * jump
                change.data = inverse * rhs
                if iteration == 0:
                    change.data += jump
                change.data += form.harmonic_extension * change
                change.data += form.inner_solve * minus
                state.vec.data += change
            newton += 1
            with task.phase("assemble"):
                form.Apply(state.vec, residual)
            if c.check(*problem.norms(residual), newton=newton, ndof=problem.X.ndof):
                break
        else:
            raise c.Failed(f"Newton took {c.MAX_NEWTON} iterations", newton=newton, ndof=problem.X.ndof)
    if task.case == "cook":
        value = problem.u(problem.mesh(*c.CORNER))[1]
    else:
        value = ngs.InnerProduct(residual[0 : problem.V.ndof], problem.weight.vec)
    return {"value": value, "ndof": problem.X.ndof, "newton": newton}


if __name__ == "__main__":
    with ngs.TaskManager() if int(c.THREADS) > 1 else nullcontext():
        c.main("NGSolve", solve, {"ngsolve": ngs.__version__})
