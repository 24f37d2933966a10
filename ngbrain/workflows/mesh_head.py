"""A head from an image or surfaces to a mesh file: labels are read or made, meshed and written, with a result."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import ngsolve as ngs
import numpy as np

from ngbrain.errors import InputError
from ngbrain.image.read.label_map import LabelMap
from ngbrain.image.read.landmarks import landmarks, write_landmarks
from ngbrain.image.read.nifti import resample_labels, write_nifti
from ngbrain.image.read.volume import Volume
from ngbrain.image.segment.topology import clean_labels
from ngbrain.mesh import files
from ngbrain.mesh.geometry.cleft import Cleft
from ngbrain.mesh.geometry.sizing import RadialSizeField
from ngbrain.mesh.head_mesh import HeadMesh
from ngbrain.mesh.improve.curving import CurvingResult, second_order_mesh
from ngbrain.mesh.resolution_study import recommend_meshes
from ngbrain.mesh.routes.craniotomy import Opening, mesh_with_cleft
from ngbrain.mesh.routes.registry import conforming_routes, find_route, mesh_labels, min_jacobian, summarise_mesh
from ngbrain.mesh.surface.cortical_files import write_cortex
from ngbrain.mesh.surface.head_outlines import LESION, VENTRICLES, Repair, excessive
from ngbrain.mesh.tet_mesh import Elements
from ngbrain.progress import Progress, display
from ngbrain.workflows.subject import Subject

OFF = 0.1
"""Relative error of a region's volume above which it is reported."""


def mesh_head(
    source: str | os.PathLike[str],
    path: str | os.PathLike[str],
    route: str = "hull",
    *,
    labels: bool | str | Mapping[int, str] = False,
    structures: bool = False,
    size: RadialSizeField | None = None,
) -> HeadMesh:
    """Mesh a head from a T1 or a label map and write the mesh, its labels and result.json, as `ngbrain mesh` does.

    Parameters
    ----------
    source : path
        A T1 (NIfTI, MGZ, a folder of DICOM), or a label map with `labels`.
    path : path
        Of the mesh: .vtkhdf, or a suffix of `ngbrain.io.exchange`.
    route : str
        How labels become tetrahedra: "hull", "lattice", "conforming", or another route that is registered
        (`ngbrain.mesh.routes.registry`).
    labels : bool, str or mapping
        Whether `source` is a label map; a scheme (freesurfer, spm, ngbrain) or number → region says what its numbers mean.
    structures : bool
        Split the tissues of a T1 into structures (`grey_left`, `brain_stem`, …).
    size : RadialSizeField, optional
        Element sizes (m); by default those of the route.

    Returns
    -------
    HeadMesh
        The mesh, its regions' volumes and quality; reads as result.json does.

    Raises
    ------
    InputError
        For a file that is not what is wanted, or `structures` of a label map.

    Examples
    --------
    >>> import tempfile
    >>> ball = np.linalg.norm(np.indices((24, 24, 24)) - 12, axis=0) < 10
    >>> grid = Volume(ball.astype(np.uint8), np.diag([5e-3, 5e-3, 5e-3, 1.0]))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_nifti(Path(folder) / "labels.nii.gz", grid)
    ...     made = mesh_head(Path(folder) / "labels.nii.gz", Path(folder) / "head.vtkhdf", "lattice", labels={1: "grey"})
    >>> sorted(made["regions"])
    ['grey']
    """
    if labels and structures:
        raise InputError("structures", "given with labels", "a T1 to find them in, or labels without it")
    with Progress(display(), text="reading and labelling") as line:
        if labels:
            named = None if labels is True else labels
            subject = Subject.from_labels(source, named)
        else:
            subject = Subject.from_structures(source) if structures else Subject.from_scan(source)
        line.callback("meshing")
        return write_subject(subject, path, route, size)


def write_subject(
    subject: Subject,
    path: str | os.PathLike[str],
    route: str = "hull",
    size: RadialSizeField | None = None,
    curve: bool = False,
    opening: Opening | None = None,
    cortex: bool = False,
    unit: str = "m",
) -> HeadMesh:
    """Mesh a subject, and write the mesh, its labels (NAME_labels.nii.gz, on the grid of the file), landmarks for 3D Slicer
    (NAME_landmarks.mrk.json) and result.json.

    Small islands and holes of the labels are removed first (`ngbrain.image.segment.topology`); the labels written are those that
    were meshed.

    Parameters
    ----------
    subject : Subject
    path : path
        The mesh file: .vtkhdf, which `ngbrain.io.load` reads exactly, or a suffix of `ngbrain.io.exchange`.
    route : str
        Meshing route.
    size : RadialSizeField, optional
        Element sizes.
    curve : bool
        Move the interfaces, with second order, closer to the interfaces of the labels (`ngbrain.mesh.improve.curving`); the mesh
        in the .vtkhdf file is curved, and so are its 10-node tetrahedra in ParaView.
    opening : Opening, optional
        Cut it open first (`ngbrain.mesh.routes.craniotomy`), with elements of `size.near` at the walls.
    cortex : bool
        Write the white and pial surfaces too (`ngbrain.mesh.surface.cortical_files`), of the labels before they are cut.
    unit : {"m", "mm"}
        Unit of length in the mesh file; a .vtkhdf and Netgen's are in m.

    Returns
    -------
    HeadMesh
        With the contents of `result.json`.

    Raises
    ------
    InputError
        Another suffix or unit; a curved mesh that is not .vtkhdf, has an opening, or is by the route `hull`, which has no tissue
        interfaces; and the errors of meshing, cutting and curving.
    """
    path, started = Path(path), time.monotonic()
    stem, own = files.stem(path), path.name.lower().endswith(files.OWN)
    if curve and not own:
        raise InputError("-o", repr(path.name), "a name that ends in .vtkhdf, as --curve is given")
    way = find_route(route)
    if curve and not way.conforms:
        wanted = f"{' or '.join(conforming_routes())}, whose tissues meet in interfaces"
        raise InputError("--curve", f"given with the route {route}", wanted)
    if curve and opening:
        raise InputError(
            "--curve", "given with --cut", "one of them: curving would move nodes off the planes of the walls"
        )
    files.check_writable(path, unit)  # before the work, not after it
    clean, tidying = clean_labels(LabelMap(_numbered(subject.labels), dict(enumerate(subject.labels.regions, 1))))
    if not clean.regions:
        found = f"{np.count_nonzero(subject.labels.volume.data)} voxels in islands, which are left out"
        raise InputError("labels", found, "a head")
    size = size or RadialSizeField(way.size, way.size)
    whole, cut = clean, {}
    if opening:
        cut = {"cut": _cut(opening.cleft(clean), opening)}
        clean, done = mesh_with_cleft(clean, opening, route, size.near, size.far)
    else:
        done = mesh_labels(clean, route, size)
    made = done.elements
    told = summarise_mesh(made, clean)
    if curve:
        mesh, curving = second_order_mesh(made, clean)
        told |= {"curved": _summary(curving)}
        for name, volume in zip(mesh.GetMaterials(), ngs.Integrate(ngs.CF(1), mesh, region_wise=True), strict=True):
            told["regions"][name]["volume_ml"] = 1e6 * float(volume)
        told["quality"]["min_jacobian"] = min_jacobian(mesh)
    else:
        mesh = None
    files.write(path, made, route, mesh, unit)
    labels = path.with_name(f"{stem}_labels.nii.gz")
    write_nifti(labels, resample_labels(_numbered(clean), subject.affine, subject.shape))
    surfaces = write_cortex(whole, subject.t1, path.parent, stem) if cortex else None
    points = landmarks(clean) | {name: np.array(point) for name, point in subject.named.items()}
    site = opening.target if opening else size.site
    shown = points["centre"] if site is None else np.array(site)
    points_file = path.with_name(f"{stem}_landmarks.mrk.json")
    write_landmarks(points_file, points)
    contrast = subject.contrast
    result = files.write_result(
        path,
        subject.source,
        route,
        made,
        started,
        left_out=way.left_out + _missing_regions(made, clean),
        notes=list(subject.notes),
        labels=", ".join(f"{i} {name}" for i, name in clean.names.items()),
        relabelled_voxels=tidying.moved,
        topology={name: asdict(topology) for name, topology in tidying.after.items()},
        **told,
        **cut,
        **({} if contrast is None else {"grey_white_contrast": contrast}),
        **({"snaps": dict(done.snaps)} if done.snaps else {}),
        **({"surfaces": surfaces} if surfaces else {}),
        repairs=[_repair_as_dict(repair) for repair in done.repairs],
        needs=[str(each) for each in recommend_meshes()],
        landmarks_mm={name: (1e3 * point).round(2).tolist() for name, point in points.items()},
        shown_mm=(1e3 * shown).round(2).tolist(),
        files=[path.name, labels.name, points_file.name, *(surfaces["files"] if surfaces else ()), "result.json"],
        checks={
            "volume_errors": _volume_errors(told["regions"]),
            "changed_ml": excessive(done.repairs, {n: r["label_volume_ml"] for n, r in told["regions"].items()}),
        },
    )
    return HeadMesh.of(result, made)


def _repair_as_dict(repair: Repair) -> dict[str, Any]:
    at = [round(1e3 * coordinate, 1) for coordinate in repair.at]
    return {"region": repair.region, "kind": repair.kind, "ml": repair.ml, "at_mm": at}


def _summary(curving: CurvingResult) -> dict[str, float]:
    """Distances of interfaces from the label interfaces before and after (mean, 95th percentile); fraction of nodes held back."""
    found = {"held_back": curving.held_back}
    for name, off in (("before", curving.distance_before), ("after", curving.distance_after)):
        found |= {f"mean_mm_{name}": 1e3 * float(off.mean()), f"p95_mm_{name}": 1e3 * float(np.percentile(off, 95))}
    return found


def _cut(cleft: Cleft, opening: Opening) -> dict[str, Any]:
    lengths = {"depth": cleft.depth, "opening": cleft.opening, "width": cleft.width, "craniotomy": opening.craniotomy}
    return {
        "target_mm": (1e3 * cleft.target).round(2).tolist(),
        "approach": cleft.out.round(4).tolist(),
        "across": cleft.across.round(4).tolist(),
        **{f"{name}_mm": round(1e3 * length, 3) for name, length in lengths.items()},
    }


def _numbered(labels: LabelMap) -> Volume:
    return Volume(labels.region_numbers(), labels.volume.affine)


def _missing_regions(made: Elements, labels: LabelMap) -> str:
    """Ventricles and lesions that are missing from a hull mesh, in words."""
    asked = [name for name in labels.regions if name == VENTRICLES or LESION.fullmatch(name)]
    lost = [name for name in asked if name not in made.regions]
    return f"; {' and '.join(lost)}, too thin or too close to their neighbours" if lost else ""


def _volume_errors(regions: Mapping[str, Mapping[str, float]]) -> dict[str, float]:
    """Relative errors of region volumes above `OFF`."""
    errors = {name: each["volume_ml"] / max(each["label_volume_ml"], 1e-9) - 1 for name, each in regions.items()}
    return {name: error for name, error in errors.items() if abs(error) > OFF}
