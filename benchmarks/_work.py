"""Work of the kinds that are done many times over, importable by workers; each returns its size and what it found."""

from __future__ import annotations

import json
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import ngsolve as ngs
import numpy as np
from _ball_waves import BallInBlock
from statics_scaling import form, known, ours

from ngbrain import datasets
from ngbrain.cli import main as command
from ngbrain.inverse import invert, invert_in_space
from ngbrain.io import WaveData
from ngbrain.scene import Scene
from ngbrain.solvers import Condensed
from ngbrain.surgery import ProtocolRun, RetractionModel
from ngbrain.threads import set_threads

MODULUS, HERTZ, DENSITY, NOISE = 3000 + 900j, 60.0, 1000.0, 0.02


def quiet() -> None:
    """One thread, and nothing of Netgen on the terminal."""
    set_threads(1)
    ngs.ngsglobals.msg_level = 0


def waves(across: int, spacing: float, dim: int, seed: int = 0) -> WaveData:
    """Shear waves that pass through, as closed forms, on a grid of `across` points a side, with noise."""
    line = np.arange(across) * spacing
    points = np.stack(np.meshgrid(*[line] * dim, indexing="ij"), axis=-1).reshape(-1, dim)
    k = 2 * np.pi * HERTZ * np.sqrt(DENSITY / MODULUS)
    along = [(i + 1) % dim for i in range(dim)]
    u = 1e-5 * np.stack([np.exp(-1j * k * points[:, i]) for i in along], axis=1)[None]
    more: dict[str, Any] = {"poisson": 0.45} if dim == 2 else {"bulk": 2e5}
    return WaveData(points, u, [HERTZ], DENSITY, "isotropic", "viscoelastic", **more).with_noise(NOISE, seed=seed)


def statics(target: float) -> int:
    """One linearised solve of a cube with a pressure, by a factor; the number of unknowns."""
    a = form("mixed", target)
    x = known(a)
    setup, solve = ours("sparsecholesky", a)
    a.Assemble()
    setup()
    solve(Condensed(a).apply(x))
    return a.space.ndof


def plane(across: float) -> int:
    """An inversion of a slice; the number of points."""
    data = waves(round(across), 2e-3, 2)
    invert(data, noise=NOISE, uniform=False, max_iterations=1)
    return len(data.points)


def zone(side: float, frequencies: int = 1) -> int:
    """An inversion in space, as of a zone, in so many cubes of third order a side; the number of cubes."""
    cells = round(side)
    data = waves(2 * cells + 1, 4e-3, 3)
    hertz = HERTZ * (1 + 0.2 * np.arange(frequencies))
    data = replace(data, displacement=np.repeat(data.displacement, frequencies, axis=0), frequency=hertz)
    block = BallInBlock(8e-3 * cells, (0.0, 0.0, 0.0), 0.0, (MODULUS, MODULUS), HERTZ, 0.0)
    found = invert_in_space(data, block.hexahedra(3, cells, len(data.points)), noise=NOISE, max_iterations=1)
    return int(found.model["n_elements"])


def two_frequencies(side: float) -> int:
    """The same zone, with two matrices to factorise."""
    return zone(side, 2)


def head(size: float) -> int:
    """The same as `retraction`, in the head MNI152."""
    return retraction(size, "demo_fast")


def retraction(size: float, scene_name: str = "idealised_fast") -> int:
    """The first steps of a retraction in the idealised head, elements `size` times as large as in its coarse mesh; tetrahedra."""
    scene = Scene.shipped(scene_name)
    mesh = {name: size * getattr(scene.mesh, name) for name in ("wall", "craniotomy", "largest")}
    scene = replace(scene, mesh=replace(scene.mesh, **mesh))
    model = RetractionModel.from_scene(scene)
    ProtocolRun(model, model.program(scene, scene.protocols[0]), None).run(until=1.0)
    return int(model.mesh.ne)


def scan(millimetres: float) -> int:
    """`ngbrain mesh` of the head MNI152 by the conforming route; tetrahedra."""
    with tempfile.TemporaryDirectory() as folder:
        (path,) = datasets.write("mni152", folder)
        made = Path(folder, "head.vtkhdf")
        status = command(
            ["mesh", str(path), "-o", str(made), "--route", "conforming", "--size", str(millimetres), "-q"]
        )
        if status:
            raise RuntimeError(f"ngbrain mesh ended with {status}")
        return int(json.loads(Path(folder, "result.json").read_text())["quality"]["n_tets"])
