"""The result of a zone, and its checkpoint file."""

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
from ngbrain.look import BriefText
from ngbrain.reading import read_npz

Array = np.ndarray


@dataclass(repr=False)
class ZoneResult(BriefText):
    """Result of a zone. Arrays are at the points of its mask.

    Parameters
    ----------
    maps : dict of str to numpy.ndarray
        Property → (k,)
    predicted : numpy.ndarray
        (loads, k, dim) m.
    weights, determined : dict of str to float
        Field → regularisation weight, and number of parameters that the data determine.
    expected : float
        Expected 2Φ, that of a fit to the noise.
    count : int
        Number of real data.
    value : float
        Objective J.
    converged : bool
        Whether fields and weights converged.
    form : str
        Element pair.
    numbers : dict of str to int
        Numbers of elements, unknowns of a wave and unknowns of fields.
    checks : dict of str to float
        As in `Inversion`.
    solves : Solves
        Counts of linear solves.
    history : list of Iteration
        The iterations.
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
        """Take what is needed of a zone's inversion."""
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
        """Write the result to a file, whole or not at all.

        Parameters
        ----------
        path : Path
            .npz file.
        problem : str
            Digest that identifies the problem.
        """
        rest = {name: value for name, value in vars(self).items() if name not in ("maps", "predicted", "history")}
        rest |= {"problem": problem, "solves": asdict(self.solves), "history": [asdict(each) for each in self.history]}
        arrays = {"predicted": self.predicted, "rest": np.array(json.dumps(rest))}
        arrays |= {f"map {name}": values for name, values in self.maps.items()}
        atomic_write(path, lambda part: np.savez(part, **arrays))  # type: ignore[arg-type]

    @staticmethod
    def load(path: Path, problem: str) -> ZoneResult:
        """Read a result from a file.

        Parameters
        ----------
        path : Path
            .npz file.
        problem : str
            Digest that identifies the problem.

        Returns
        -------
        ZoneResult
            The result.

        Raises
        ------
        InputError
            The file is of another problem, or not such a file.
        """
        try:
            file = read_npz(path, "checkpoint")
            rest = json.loads(str(file["rest"]))
            maps = {name[4:]: values for name, values in file.items() if name.startswith("map ")}
            predicted, stored = file["predicted"], rest.pop("problem")
        except (KeyError, ValueError, AttributeError, TypeError) as error:
            raise InputError("checkpoint", f"{path}, which cannot be read", "what an inversion has written") from error
        if stored != problem:
            raise InputError(
                "checkpoint", f"{path} of another problem", "the same data, noise and zones, or another folder"
            )
        history = [Iteration(**each) for each in rest.pop("history")]
        return ZoneResult(maps=maps, predicted=predicted, history=history, solves=Solves(**rest.pop("solves")), **rest)


def problem_digest(data: WaveSubset, cells: VoxelLattice, *rest: object) -> str:
    """Return a digest that identifies the problem of a zone.

    Parameters
    ----------
    data : WaveSubset
        The zone's data.
    cells : VoxelLattice
        Its cells.
    *rest : object
        Whatever else it depends on.

    Returns
    -------
    str
        The digest.
    """
    parts = [data.points, data.displacement, data.mask, data.dirichlet, data.frequency, data.rms]
    parts += [*cells.planes, cells.cells]
    parts += [np.asarray(each) for each in (data.labels, data.fibre, data.noise) if each is not None]
    words = repr((data.density, data.symmetry, data.rheology, data.poisson, data.bulk, cells.form, rest))
    arrays = b"".join(np.ascontiguousarray(part).tobytes() for part in parts)
    return hashlib.sha256(arrays + words.encode()).hexdigest()
