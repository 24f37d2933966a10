"""What one writes with FElupe: its own materials, three-field elements and Newton's method, and MKL's Pardiso."""

from __future__ import annotations

import _case as c
import felupe as fem
import numpy as np

DIRECT = c.Pardiso()


def region_of(task: c.Task) -> tuple[fem.Mesh, fem.Region]:
    """The mesh of a case and its element."""
    shape, order, flat = task.element.shape, task.element.order, task.case == "cook"
    if order not in (1, 2) or (shape, order) == ("P", 1):
        raise c.NotOffered(task.element.key)
    mesh = fem.Rectangle(n=task.n + 1) if flat else fem.Cube(b=(c.L,) * 3, n=task.n + 1)
    if flat:
        mesh.points[:] = np.column_stack(c.cook_map(*mesh.points.T))
    if shape == "P":
        mesh = fem.mesh.triangulate(mesh).add_midpoints_edges()
        return mesh, (fem.RegionQuadraticTriangle if flat else fem.RegionQuadraticTetra)(mesh)
    if order == 1:
        return mesh, (fem.RegionQuad if flat else fem.RegionHexahedron)(mesh)
    mesh = mesh.add_midpoints_edges().add_midpoints_faces()
    if flat:
        return mesh, fem.RegionBiQuadraticQuad(mesh)
    mesh = mesh.add_midpoints_volumes()
    return mesh, fem.RegionTriQuadraticHexahedron(mesh)


def solid_of(task: c.Task, region: fem.Region) -> fem.SolidBody:
    """The material on the element's fields: the displacement, or with it pressure and volume ratio."""
    flat, key = task.case == "cook", task.element.key
    law = fem.NeoHookeCompressible(c.COOK_MU, c.COOK_K) if flat else fem.NeoHooke(mu=c.MU, bulk=c.K)
    if key in ("P2/P1", "Q2/L2(1)", "Q1/L2(0)"):
        return fem.SolidBody(fem.ThreeFieldVariation(law), fem.FieldsMixed(region, n=3, planestrain=flat))
    if task.element.pressure is not None:
        raise c.NotOffered(key)
    plain = fem.FieldPlaneStrain(region, dim=2) if flat else fem.Field(region, dim=3)
    return fem.SolidBody(law, fem.FieldContainer([plain]))


def supports(task: c.Task, field: fem.Field) -> dict[str, fem.Boundary]:
    """What is prescribed; "move" is driven."""

    def at(*places: float):
        return lambda x: np.any([np.isclose(x, place) for place in places], axis=0)

    if task.case == "cook":
        return {"left": fem.Boundary(field, fx=at(0))}
    found = {}
    if task.case == "smooth":
        found["x"] = fem.Boundary(field, fx=at(0, c.L), skip=(0, 1, 1))
        found["y"] = fem.Boundary(field, fy=at(0, c.L), skip=(1, 0, 1))
    found["base"] = fem.Boundary(field, fz=at(0))
    found["top"] = fem.Boundary(field, fz=at(c.L), skip=(0, 0, 1))
    return found | {"move": fem.Boundary(field, fz=at(c.L), skip=(1, 1, 0))}


def shear(mesh: fem.Mesh, order: int, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes of Cook's right side and the consistent forces of its dead load."""
    side = np.flatnonzero(np.isclose(mesh.points[:, 0], c.CORNER[0]))
    side = side[np.argsort(mesh.points[side, 1])]
    weights = np.zeros(len(side))
    rule = np.array([1, 4, 1]) / 6 if order == 2 else np.array([1, 1]) / 2
    for i in range(n):
        weights[order * i : order * i + order + 1] += rule
    return side, c.TRACTION * 16 / n * weights


def solve(task: c.Task) -> dict:
    """FElupe's Newton in equal load steps."""
    with task.phase("compile"):  # the tables of shape functions
        mesh, region = region_of(task)
        solid = solid_of(task, region)
    fields = solid.field
    DIRECT.task = task
    field, newton, items = fields[0], 0, [solid]
    bounds, ndof = supports(task, field), sum(f.values.size for f in fields.fields)
    if task.case == "cook":
        side, forces = shear(mesh, task.element.order, task.n)
        items.append(fem.PointLoad(fields, side))
    else:
        moved = bounds["move"].points
        weight = np.ones(len(moved))
        if task.case == "smooth":
            weight = np.prod(np.cos(np.pi * mesh.points[moved, :2] / c.L), axis=1)
    for step in range(1, task.steps + 1):
        if task.case == "cook":
            items[1].update(step / task.steps * np.column_stack([0 * forces, forces]))
        else:
            push = (c.WAVE if task.case == "smooth" else c.PRESS) * step / task.steps
            bounds["move"].value = push * weight[:, None] if task.case == "smooth" else push
        dof0, dof1 = fem.dof.partition(fields, bounds)
        loads = {"dof0": dof0, "dof1": dof1, "ext0": fem.dof.apply(fields, bounds, dof0)}
        counted = Count()
        try:
            fem.newtonraphson(
                items=items, **loads, solver=DIRECT, tol=c.TOLERANCE, verbose=0, maxiter=c.MAX_NEWTON, plugins=[counted]
            )
        except ValueError as error:
            reason = "Newton: " + " ".join(str(error).split())
            raise c.Failed(reason, newton=newton + counted.iterations, ndof=ndof) from error
        newton += counted.iterations
    task.phases["assemble"] = c.cpu() - task.start - sum(task.phases.values())
    if task.case == "cook":
        value = field.values[side[-1], 1]
    else:
        inner = solid.assemble.vector(fields).toarray().ravel()[: field.values.size].reshape(field.values.shape)
        value = inner[moved, 2] @ weight
    return {"value": float(value), "ndof": ndof, "newton": newton}


class Count(fem.Plugin):
    """Newton's iterations, also of a solve that fails."""

    def __init__(self) -> None:
        self.iterations = 0

    def after_iteration(self, context, state) -> None:
        self.iterations += 1


if __name__ == "__main__":
    np.seterr(all="ignore")
    c.main("FElupe", solve, {"felupe": fem.__version__, "numpy": np.__version__, **DIRECT.versions})
