"""ngbrain on a case, in a process of its own as every peer is: its checks of mesh, form and states are all counted."""

from __future__ import annotations

import _case as c
import ngsolve as ngs
from ngsolve_plain import domain, wave

import ngbrain
from ngbrain.errors import ConvergenceError, InvertedElementError
from ngbrain.forward import LoadPath, Material, Problem, TractionLoad, newton_for
from ngbrain.materials import NeoHooke, UnsplitNeoHooke, squared_log
from ngbrain.solvers import PathRecord
from ngbrain.threads import set_threads

LABELS = {"residual": "assemble"}


def body_of(task: c.Task) -> Problem:
    """A case's body."""
    mesh, form = domain(task), task.element.key
    if task.case == "cook":
        tissue = Material(UnsplitNeoHooke(c.COOK_MU), c.COOK_K, change=squared_log)
        return Problem(mesh, {".*": tissue}, {"left": 0}, [TractionLoad("right", (0, c.TRACTION))], element=form)
    supports = {}
    if task.case == "smooth":
        supports |= {"back|front": (0, None, None), "left|right": (None, 0, None)}
    push = c.WAVE if task.case == "smooth" else c.PRESS
    supports |= {"bottom": 0, "top": (0, 0, push * wave(task.case))}
    return Problem(mesh, {".*": Material(NeoHooke(c.MU), c.K)}, supports, element=form)


def work(record: PathRecord) -> dict:
    """What a solve took."""
    found = {"ndof": record.ndof, "newton": record.tried, "factorisations": record.work.factorisations}
    found |= {"steps": len(record.history), "cuts": len(record.cuts), "min_det_F": record.min_det_F}
    return found | {"form": record.element, "solver": record.solver}


def solve(task: c.Task) -> dict:
    """Load steps that cut themselves, to the peers' tolerance."""
    with task.phase("compile"):
        body = body_of(task)
    record = None
    try:
        record = LoadPath(body).solve(task.steps, newton=newton_for(body, rtol=c.TOLERANCE))
    except (ConvergenceError, InvertedElementError) as error:
        record = error.result
        raise c.Failed(record.reason, **work(record), order=body.element.order) from error
    finally:
        for phase, spent in (record.seconds if record else {}).items():
            name = LABELS.get(phase, phase)
            task.phases[name] = task.phases.get(name, 0.0) + spent
    if task.case == "cook":
        value = body.u(body.mesh(*c.CORNER))[1]
    else:
        value = body.conjugate(ngs.CF((0, 0, wave(task.case))), "top")
    return {"value": value, "order": body.element.order} | work(record)


if __name__ == "__main__":
    c.STEPS["cook"] = 1  # it cuts steps itself
    set_threads(int(c.THREADS))
    c.main("ngbrain", solve, {"ngsolve": ngs.__version__, "ngbrain": ngbrain.__version__})
