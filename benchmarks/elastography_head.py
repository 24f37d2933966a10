"""Stiffness of a head in space from made-up waves with noise: tissue by tissue, and of a stiff inclusion of 15 mm.

The brain of MNI152 at 50 Hz, its skull nodding and moved sideways; G* by tissue, an inclusion twice as stiff as white matter.
The waves are simulated with elements of another order and size than the inversion's, taken at the voxels of 2 mm and given
2 % noise, those at the skull too, whose displacement is an unknown of the inversion. Methods: Gauss-Newton with a field for
each label (labels known, the inclusion's too), with one field for all, and with no model (algebraic and local-frequency
inversion). Error: of the tissue medians, relative; beside it the inclusion's contrast (median of its core, a voxel off its
border, over that of the 5 mm around it) over the true one.

Left out: fluid in the sulci (counts as grey matter), the pressure in the ventricles (their walls are free), the tissue's bulk
modulus (2e5 Pa, known, in data and inversion alike), fibres.

    python benchmarks/elastography_head.py [--quick] [--json]      last line of --json: a list of records
    python benchmarks/elastography_head.py --chart FILE.png < records.json
"""

from __future__ import annotations

import resource
import sys
import time
from dataclasses import dataclass

import ngsolve as ngs
import numpy as np
from _command import main
from _head_waves import CENTRE, MODULI, RADIUS, VOXEL, DENSITY, FREQUENCY, Head, body, head, simulated
from scipy.spatial import KDTree

from ngbrain.adjoint.reduced import Reduced
from ngbrain.errors import require
from ngbrain.forward.points import evaluation, inside
from ngbrain.forward.sensitivity import BOUNDARY, WaveModel
from ngbrain.inverse.direct import helmholtz_of_curl, local_frequency
from ngbrain.inverse.gauss_newton import Iteration
from ngbrain.inverse.iterative import Iterative
from ngbrain.inverse.labels import by_label, shares
from ngbrain.inverse.misfit import LeastSquares
from ngbrain.inverse.parameters import Fields, Scaled, Unknown
from ngbrain.inverse.regularise import smooth
from ngbrain.inverse.weights import EvidenceOfNoise
from ngbrain.io.waves.data import WaveData

Array = np.ndarray
NOISE = 0.02
START = 2.2e3 + 0.9e3j
"""Pa: between grey and white matter."""


@dataclass(frozen=True, eq=False)
class Experiment:
    """Noisy waves at voxels, and what is true there."""

    subject: Head
    points: Array
    displacement: Array
    sigma: Array
    label: Array

    @property
    def truth(self) -> Array:
        """G* (n,) Pa."""
        return np.array([MODULI[name] for name in self.subject.names])[self.label]

    @classmethod
    def made(cls, size: float, form: str, seed: int = 0) -> Experiment:
        """Simulated with elements of `size` (m) and order `form`."""
        subject = head()
        found = simulated(subject, size, form)
        u, random = found["displacement"], np.random.default_rng(seed)
        deviation = NOISE * np.sqrt((np.abs(u) ** 2).mean(axis=1, keepdims=True) / 2)
        u = u + deviation * (random.normal(size=u.shape) + 1j * random.normal(size=u.shape))
        return cls(subject, found["points"], u, deviation, subject.label_at(found["points"]))

    def inside(self, mesh: ngs.Mesh) -> Experiment:
        """What lies in a mesh."""
        kept = inside(mesh, self.points)
        return Experiment(self.subject, self.points[kept], self.displacement[:, kept], self.sigma, self.label[kept])


def at_skull(experiment: Experiment, model: WaveModel) -> Array:
    """Displacements of the held unknowns to begin with, as in θ: local linear fits of the data, at corners of elements."""
    mesh, made = model.body.mesh, model.body
    corners = np.array([v.point for v in mesh.vertices])
    width = made.fes.ndof // 3
    near = KDTree(experiment.points)
    held = [i for i in range(mesh.nv) if made.held[i]]
    _, found = near.query(corners[held], 40)
    parts = []
    for u in experiment.displacement:
        g = np.zeros(made.fes.ndof, complex)
        for i, some in zip(held, found, strict=True):
            A = np.column_stack([np.ones(len(some)), experiment.points[some] - corners[i]])
            g[i + width * np.arange(3)] = np.linalg.lstsq(A.astype(complex), u[some], rcond=None)[0][0]
        parts += [g[model.driving].real, g[model.driving].imag]
    return np.concatenate(parts)


def inverted(experiment: Experiment, size: float, form: str, labelled: bool, rounds: int, checkpoint: str | None) -> dict:
    """Gauss-Newton with elements of `size` (m); G* at the experiment's points."""
    begun = time.process_time(), time.monotonic()
    mesh, degree = experiment.subject.mesh(size), int(form[1])
    experiment = experiment.inside(mesh)
    names = experiment.subject.names if labelled else ("tissue",)
    label_at = experiment.subject.label_at if labelled else lambda x: np.zeros(len(x), int)
    at = shares(mesh, degree, label_at, names)
    space = ngs.H1(mesh, order=1)
    fields = {f"{part} {name}": ngs.GridFunction(space) for name in names for part in ("storage", "loss")}
    for name, field in fields.items():
        field.Set(START.real if name.startswith("storage") else START.imag)
    storage, loss = ({name: fields[f"{part} {name}"] for name in names} for part in ("storage", "loss"))
    made = body(mesh, by_label(at, storage) + 1j * by_label(at, loss), form, degree)
    model = WaveModel(made, fields, experiment.points)
    misfit = LeastSquares(experiment.displacement, experiment.sigma)
    unknowns: dict[str, Unknown] = {
        name: Unknown(START.real if name.startswith("storage") else START.imag) for name in fields
    }
    scale = float(experiment.sigma.mean())
    unknowns[BOUNDARY] = Unknown(at_skull(experiment, model), Scaled(scale))
    search = Fields(model.theta, model.blocks, unknowns)
    regular = {name: smooth(space, search.start[search.blocks[name]]) for name in fields}
    reduced = Reduced(model, misfit, search, regular, dict.fromkeys(fields, 0.1 * misfit.count))

    def tell(done: Iteration) -> None:
        weights = ", ".join(f"{value:.3g}" for value in done.weights.values())
        text = f"misfit {done.misfit / done.expected:.3f}, change {done.change:.4f}, step {done.step:.2f}, weights {weights}"
        print(f"{text}, CG {way.iterations[-2:]}, {time.monotonic() - begun[1]:.0f} s", file=sys.stderr, flush=True)

    way = Iterative(reduced, EvidenceOfNoise(), checkpoint=checkpoint, tell=tell, most=30)
    found = way.descend(search.start, rounds)
    values, to_points = search.values(found.x), evaluation(space, experiment.points)
    nodal = [values[f"storage {name}"] + 1j * values[f"loss {name}"] for name in names]
    everywhere = np.array([to_points @ field for field in nodal])
    own = experiment.label if labelled else np.zeros(len(experiment.points), int)
    return {
        "modulus": everywhere[own, np.arange(len(own))], "experiment": experiment, "ndof": made.fes.ndof,
        "cpu_s": time.process_time() - begun[0], "wall_s": time.monotonic() - begun[1], "converged": found.converged,
        "misfit": found.level.ratio, "iterations": way.iterations, "steps": len(found.history),
        "memory_gib": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20,
    }  # fmt: skip


def judged(experiment: Experiment, modulus: Array) -> dict:
    """Tissue medians relative to the truth, the inclusion's contrast relative to the true one."""
    known = np.isfinite(modulus)
    found: dict = {}
    for number, name in enumerate(experiment.subject.names):
        mine = (experiment.label == number) & known
        for part, of in (("storage", np.real), ("loss", np.imag)):
            if mine.any():
                found[f"{name}_{part}"] = float(np.median(of(modulus[mine])) / of(MODULI[name]) - 1)
    away = np.linalg.norm(experiment.points - CENTRE, axis=1)
    core, around = away < RADIUS - VOXEL, (away > RADIUS) & (away < RADIUS + 5e-3)
    ratio, true = (
        np.nanmedian(values[core].real) / np.nanmedian(values[around].real) for values in (modulus, experiment.truth)
    )
    tissue = [abs(found[f"{name}_storage"]) for name in ("grey", "white")]
    return found | {"contrast": float(ratio), "true_contrast": float(true), "error": float(max(tissue))}


def direct(experiment: Experiment) -> dict[str, Array]:
    """Method → G* at the points, from inversions that know no boundary and no model."""
    x = experiment.points
    index = np.rint((x - x.min(axis=0)) / VOXEL).astype(int)
    shape = index.max(axis=0) + 1
    grid = x.min(axis=0) + VOXEL * np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1).reshape(-1, 3)
    own = np.ravel_multi_index(index.T, shape)
    u = np.zeros((len(experiment.displacement), len(grid), 3), complex)
    u[:, own] = experiment.displacement
    mask = np.zeros(len(grid), bool)
    mask[own] = True
    data = WaveData(
        grid, u, np.full(len(u), FREQUENCY), DENSITY, "isotropic", "viscoelastic", poisson=0.495, mask=mask, noise=NOISE
    )
    methods = {"ngbrain:direct": helmholtz_of_curl, "ngbrain:local-frequency": local_frequency}
    return {name: method(data)[own] for name, method in methods.items()}


def measure(quick: bool) -> list[dict]:
    """All records."""
    simulation, meshes = ((10e-3, "P3"), (14e-3, "P3")) if quick else ((14e-3, "P4"), (10e-3, "P3"))
    experiment = Experiment.made(*simulation)
    if quick:
        experiment = Experiment(
            experiment.subject, experiment.points[::4], experiment.displacement[:, ::4], experiment.sigma, experiment.label[::4]
        )
    records = []
    for name, labelled in (("ngbrain:gauss-newton labels", True), ("ngbrain:gauss-newton one field", False)):
        found = inverted(experiment, *meshes, labelled, 8, None)
        modulus, own = found.pop("modulus"), found.pop("experiment")
        records.append({"method": name, "order": int(meshes[1][1]), "n_points": len(own.points), **found, **judged(own, modulus)})
    return records


def line(r: dict) -> str:
    """A record to read."""
    medians = ", ".join(f"{name.replace('_', ' ')} {100 * r[name]:+.1f}" for name in r if name.endswith(("storage", "loss")))
    return f"{r['method']:<32} {medians} %  contrast {r['contrast']:.2f} of {r['true_contrast']:.2f}  {r.get('cpu_s', 0):.0f} s"
