"""A head from a file to a mesh in a file: labels read or made, meshed, written, and what came of it."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import ngsolve as ngs
import numpy as np

from ngbrain.errors import InputError
from ngbrain.image.labelfile import TISSUES, read_labels
from ngbrain.image.labelmap import LabelMap
from ngbrain.image.landmarks import landmarks
from ngbrain.image.niftifile import on_grid, write_nifti
from ngbrain.image.tissues import structured, tissues
from ngbrain.image.topology import tidied
from ngbrain.image.volume import Volume, read_scan
from ngbrain.io import QuadraticGrid, save, versions, write_json
from ngbrain.io.exchange import SUFFIXES, write_mesh
from ngbrain.mesh.curving import Curving, bent
from ngbrain.mesh.elements import Elements
from ngbrain.mesh.grading import Graded
from ngbrain.mesh.routes import ROUTES, described, meshed_by, min_jacobian


@dataclass(frozen=True, eq=False)
class Subject:
    """Labels of a head and where they come from.

    labels   what is meshed; t1 the scan on the same voxels, or None
    affine, shape  of the file's own grid, to which maps go back
    source   the file
    """

    labels: LabelMap
    t1: Volume | None
    affine: np.ndarray
    shape: tuple[int, int, int]
    source: str

    @classmethod
    def of_scan(cls, path: str | os.PathLike[str]) -> Subject:
        """From a T1; raises what `read_scan` and `tissues` raise."""
        scan = read_scan(path)
        return cls(LabelMap(tissues(scan), TISSUES), scan.volume, scan.file_affine, scan.file_shape, scan.source)

    @classmethod
    def of_structures(cls, path: str | os.PathLike[str]) -> Subject:
        """From a T1, its tissues split into structures (`ngbrain.image.structures`): `grey_left`, `brain_stem`, …

        Patterns pick them in a mesh of a route that conforms to tissues: `white.*` all white matter but the corpus callosum,
        `.*_left` a side; the boundary under the tentorium is `(grey|white)_(left|right)_(grey|white)_cerebellum` where
        cerebrum and cerebellum touch. Falx and tentorium as surfaces: `ngbrain.image.dura`.

        Raises what `read_scan` and `structured` raise.
        """
        scan = read_scan(path)
        return cls(structured(scan).labels, scan.volume, scan.file_affine, scan.file_shape, scan.source)

    @classmethod
    def of_labels(cls, path: str | os.PathLike[str], names: str | Mapping[int, str] | None = None) -> Subject:
        """From a map of labels; raises what `read_labels` raises."""
        labels = read_labels(path, names)
        shape = labels.volume.data.shape
        return cls(labels, None, labels.volume.affine, (shape[0], shape[1], shape[2]), str(path))


def write_subject(
    subject: Subject,
    path: str | os.PathLike[str],
    route: str = "hull",
    size: Graded | None = None,
    curve: bool = False,
) -> tuple[dict[str, Any], Elements]:
    """Mesh a subject, and write the mesh, its labels (NAME_labels.nii.gz, on the grid of the file) and result.json beside it.

    Small islands and holes of the labels go first (`ngbrain.image.topology`); the labels written are those that were meshed.

    path   .vtkhdf, which `ngbrain.io.load` gives back to the bit, or a suffix of `ngbrain.io.exchange`
    curve  bring the interfaces, with second order, closer to where the labels' regions meet (`ngbrain.mesh.curving`): the mesh
           in the .vtkhdf file is curved, and so are its 10-node tetrahedra in ParaView

    Returns the result and the mesh, with straight edges. Raises `InputError` for another suffix, for a curved mesh that is not
    .vtkhdf or by the route `hull`, which has no tissues' interfaces, and what `meshed_by` and `curved` raise.
    """
    path, started = Path(path), time.monotonic()
    if curve and not path.name.endswith(".vtkhdf"):
        raise InputError("-o", repr(path.name), "a name that ends in .vtkhdf, as --curve is given")
    if curve and route == "hull":
        raise InputError(
            "--curve", "given with the route hull", "lattice or conforming, whose tissues meet in interfaces"
        )
    stem = _stem(path)  # before the work, not after it
    path.parent.mkdir(parents=True, exist_ok=True)
    clean, tidying = tidied(LabelMap(_numbered(subject.labels), dict(enumerate(subject.labels.regions, 1))))
    done = meshed_by(clean, route, size)
    made = done.elements
    told = described(made, clean)
    if curve:
        mesh, curving = bent(made, clean)
        told |= {"curved": _summary(curving)}
        for name, volume in zip(mesh.GetMaterials(), ngs.Integrate(ngs.CF(1), mesh, region_wise=True), strict=True):
            told["regions"][name]["volume_ml"] = 1e6 * float(volume)
        told["quality"]["min_jacobian"] = min_jacobian(mesh)
    else:
        mesh = made.mesh() if path.name.endswith(".vtkhdf") else None
    if mesh is not None:
        save(path, QuadraticGrid(mesh), state={"route": route})
    else:
        write_mesh(path, made)
    labels = path.with_name(f"{stem}_labels.nii.gz")
    write_nifti(labels, on_grid(clean.volume, subject.affine, subject.shape))
    points = landmarks(clean)
    shown = np.array(size.site) if size and size.site else points["centre"]
    result = {
        "verb": "mesh",
        "source": subject.source,
        "route": route,
        "left_out": ROUTES[route].left_out,
        "labels": ", ".join(f"{i} {name}" for i, name in clean.names.items()),
        "relabelled_voxels": tidying.moved,
        "topology": {name: asdict(topology) for name, topology in tidying.after.items()},
        **told,
        **({"snaps": dict(done.snaps)} if done.snaps else {}),
        "landmarks_mm": {name: (1e3 * point).round(2).tolist() for name, point in points.items()},
        "shown_mm": (1e3 * shown).round(2).tolist(),
        "boundaries": sorted(made.boundaries),
        "files": [path.name, labels.name, "result.json"],
        "checks": {},
        "versions": versions(),
        "seed": 0,
        "threads": 1,
        "time_s": time.monotonic() - started,
    }
    write_json(path.with_name("result.json"), result)
    return result, made


def _summary(curving: Curving) -> dict[str, float]:
    """Distances of interfaces from where labels meet, before and after, mean and 95th percentile; share of nodes held back."""
    found = {"held_back": curving.held}
    for name, off in (("before", curving.before), ("after", curving.after)):
        found |= {f"mean_mm_{name}": 1e3 * float(off.mean()), f"p95_mm_{name}": 1e3 * float(np.percentile(off, 95))}
    return found


def _numbered(labels: LabelMap) -> Volume:
    return Volume(labels.numbered(), labels.volume.affine)


def _stem(path: Path) -> str:
    for suffix in (".vtkhdf", *SUFFIXES):
        if path.name.lower().endswith(suffix):
            return path.name[: -len(suffix)]
    raise InputError("-o", repr(path.name), "a name that ends in " + ", ".join((".vtkhdf", *SUFFIXES)))
