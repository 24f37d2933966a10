"""What comes back of a zone that was inverted, and how it is kept in a file."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from ngbrain.atomic import atomic_write
from ngbrain.errors import InputError
from ngbrain.forward.common.solve_counts import Solves
from ngbrain.inverse.data.subset import WaveSubset
from ngbrain.inverse.elastography.result import Inversion
from ngbrain.inverse.optimise.result import Iteration
from ngbrain.inverse.problem.voxel_lattice import VoxelLattice
from ngbrain.reading import read_npz

Array = np.ndarray


@dataclass
class ZoneResult:
    """Of one zone; arrays are at the points of its mask.

    maps         quantity → (k,)
    predicted    (loads, k, dim) m
    weights, determined   of each field
    expected, count       2Φ of a fit as good as the noise allows, real data
    value       J
    numbers      elements, unknowns of a wave, unknowns of fields
    """

    maps: dict[str, Array]
    predicted: Array
    weights: dict[str, float]
    determined: dict[str, float]
    expected: float
    count: int
    value: float
    converged: bool
    form: str
    numbers: dict[str, int]
    checks: dict[str, float]
    solves: Solves
    history: list[Iteration]

    @staticmethod
    def from_inversion(inversion: Inversion) -> ZoneResult:
        """What is needed of a zone's inversion."""
        mask, row = inversion.data.mask, inversion.starts[-1]
        return ZoneResult(
            maps={name: values[mask] for name, values in inversion.maps.items()},
            predicted=inversion.predicted[:, mask],
            weights=dict(inversion.weights),
            determined=dict(inversion.determined),
            expected=row.expected,
            count=2 * int(np.sum(inversion.data.measured[:, mask] & ~np.isnan(inversion.predicted[:, mask]))),
            value=row.value,
            converged=row.converged,
            form=inversion.model["form"],
            numbers={name: inversion.model[name] for name in ("n_elements", "n_unknowns", "n_parameters")},
            checks={name: float(value) for name, value in inversion.checks.items()},
            solves=inversion.solves,
            history=inversion.history,
        )

    def save(self, path: Path, problem: str) -> None:
        """Write it, whole or not at all; `problem` tells it from others."""
        rest = {name: value for name, value in vars(self).items() if name not in ("maps", "predicted", "history")}
        rest |= {"problem": problem, "solves": asdict(self.solves), "history": [asdict(each) for each in self.history]}
        arrays = {"predicted": self.predicted, "rest": np.array(json.dumps(rest))}
        arrays |= {f"map {name}": values for name, values in self.maps.items()}
        atomic_write(path, lambda part: np.savez(part, **arrays))  # type: ignore[arg-type]

    @staticmethod
    def load(path: Path, problem: str) -> ZoneResult:
        """Read it. Raises `InputError` where it is of another problem, or no such file."""
        try:
            file = read_npz(path, "checkpoint")
            rest = json.loads(str(file["rest"]))
            maps = {name[4:]: values for name, values in file.items() if name.startswith("map ")}
            predicted, told = file["predicted"], rest.pop("problem")
        except (KeyError, ValueError, AttributeError, TypeError) as error:
            raise InputError("checkpoint", f"{path}, which cannot be read", "what an inversion has written") from error
        if told != problem:
            raise InputError(
                "checkpoint", f"{path} of another problem", "the same data, noise and zones, or another folder"
            )
        history = [Iteration(**each) for each in rest.pop("history")]
        return ZoneResult(maps=maps, predicted=predicted, history=history, solves=Solves(**rest.pop("solves")), **rest)


def problem_digest(data: WaveSubset, cells: VoxelLattice, *rest: object) -> str:
    """Tells a zone's problem from others, by its arrays and whatever else it depends on."""
    parts = [data.points, data.displacement, data.mask, data.dirichlet, data.frequency, data.rms]
    parts += [*cells.planes, cells.cells]
    parts += [np.asarray(each) for each in (data.labels, data.fibre, data.noise) if each is not None]
    words = repr((data.density, data.symmetry, data.rheology, data.poisson, data.bulk, cells.form, rest))
    arrays = b"".join(np.ascontiguousarray(part).tobytes() for part in parts)
    return hashlib.sha256(arrays + words.encode()).hexdigest()
