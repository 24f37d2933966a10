"""Heads that nothing was tuned on: which of them are recognised, segmented and meshed, and how well.

Runs over a folder of T1s (NIfTI or MGH). A head NAME_t1.nii.gz may have a map of labels NAME_muse_labels.nii.gz in the
MUSE numbering on the same voxels; its tissues are then compared, and the ceiling is printed: the Dice overlaps that the
best thresholds inside MUSE's own grey and white matter reach, cerebrum and cerebellum apart, deep grey matter given.

    python benchmarks/heads_of_strangers.py FOLDER [--mesh] [--executor WHO] > records.json      a list of records, one a head
    python benchmarks/heads_of_strangers.py --table < records.json              the same as a table in Markdown
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
import warnings
from pathlib import Path

import meshio
import numpy as np
from _command import add_executor, executor_of, run, sweep

from ngbrain.errors import InputError, require
from ngbrain.image import read_scan
from ngbrain.image.niftifile import on_grid
from ngbrain.image.segment import CSF, GREY, VENTRICLE, WHITE
from ngbrain.image.tissues import grey_white_contrast, tissues

Record = dict

ENDINGS = (".nii.gz", ".nii", ".mgz", ".mgh")
# Numbers of MUSE.
VENTRICLES = (4, 11, 49, 50, 51, 52)
WHITE_MATTER = (40, 41, *range(81, 96))
DEEP_GREY = (23, 30, 31, 32, 36, 37, 47, 48, *range(55, 61), 75, 76)
CEREBELLUM = (38, 39, 40, 41, 71, 72, 73)
LEFT_OUT = (1, 35, 61, 62)  # fluid outside, the brain stem


def anew(path: Path, mesh: bool) -> Record:
    """The same with an empty cache, so that nothing is there from before."""
    with tempfile.TemporaryDirectory() as cache:
        os.environ["NGBRAIN_CACHE"] = cache
        return measure(path, mesh)


def measure(path: Path, mesh: bool) -> Record:
    """Everything about one head."""
    found: Record = {"head": path.name, "recognised": False}
    begun = time.process_time()
    try:
        scan = read_scan(path)
        found["voxel_mm"] = [round(1e3 * float(s), 2) for s in np.linalg.norm(scan.file_affine[:3, :3], axis=0)]
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            labels = tissues(scan)
            found["contrast"] = round(grey_white_contrast(scan), 2)
        found["recognised"] = True
        found["warnings"] = sorted({str(each.message) for each in caught})
        found["cpu_s"] = round(time.process_time() - begun, 1)
    except InputError as error:
        return found | {"reason": str(error).removeprefix(f"{path}: ")}
    counts = np.bincount(labels.data.ravel(), minlength=5) * labels.voxel_volume * 1e6
    found["brain_ml"] = round(float(counts[1:].sum()), 1)
    for name, label in (("csf", CSF), ("grey", GREY), ("white", WHITE), ("ventricles", VENTRICLE)):
        found[f"{name}_ml"] = round(float(counts[label]), 1)
    muse = path.with_name(path.name.replace("_t1.", "_muse_labels."))
    if muse != path and muse.exists():
        nibabel = require("nibabel", "mri")
        theirs = np.rint(np.asarray(nibabel.load(muse).dataobj)).astype(int)
        grey_values = np.asarray(nibabel.load(path).dataobj, float)
        found |= overlaps(on_grid(labels, scan.file_affine, scan.file_shape).data, theirs, grey_values)
    return found | (meshed(path) if mesh else {})


def overlaps(ours: np.ndarray, muse: np.ndarray, grey_values: np.ndarray) -> Record:
    """Dice overlaps with a map of MUSE, and the ceiling of thresholds for grey and white matter."""
    truth = classes(muse)
    counted = ~np.isin(muse, LEFT_OUT)
    found = {}
    for name, label in (("grey", GREY), ("white", WHITE), ("ventricles", VENTRICLE)):
        found[f"dice_{name}"] = round(dice((ours == label) & counted, truth == label), 4)
    found["dice_brain"] = round(dice((ours > 0) & counted, truth > 0), 4)
    for name, value in zip(("grey", "white"), ceiling(grey_values, muse), strict=True):
        found[f"ceiling_{name}"] = round(value, 4)
    return found


def classes(muse: np.ndarray) -> np.ndarray:
    """GREY, WHITE and VENTRICLE of a map of MUSE; deep grey matter counts as grey, cerebellar white matter as white."""
    found = np.zeros(muse.shape, np.uint8)
    found[(muse >= 100) | np.isin(muse, (38, 39, 71, 72, 73)) | np.isin(muse, DEEP_GREY)] = GREY
    found[np.isin(muse, WHITE_MATTER)] = WHITE
    found[np.isin(muse, VENTRICLES)] = VENTRICLE
    found[np.isin(muse, LEFT_OUT)] = 0
    return found


def dice(one: np.ndarray, other: np.ndarray) -> float:
    """Overlap of two masks, 0 to 1."""
    return float(2 * (one & other).sum() / max(one.sum() + other.sum(), 1))


def ceiling(grey_values: np.ndarray, muse: np.ndarray) -> tuple[float, float]:
    """Dice overlaps of grey and white matter that the best thresholds within them reach, deep grey matter given."""
    truth = classes(muse)
    deep = np.isin(muse, DEEP_GREY)
    free, below = np.isin(truth, (GREY, WHITE)) & ~deep, np.isin(muse, CEREBELLUM)
    grey = deep.copy()
    for region in (free & below, free & ~below):
        values, white = grey_values[region], truth[region] == WHITE
        trials = np.quantile(values, np.linspace(0.02, 0.98, 193))
        scores = [dice(values < t, ~white) + dice(values >= t, white) for t in trials]
        grey[region] = values < trials[int(np.argmax(scores))]
    return dice(grey, truth == GREY), dice(free & ~grey, truth == WHITE)


def meshed(path: Path) -> Record:
    """What `ngbrain mesh` with no option but the route makes of a head."""
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder, "head.vtu")
        before = _children()
        done = subprocess.run(
            [sys.executable, "-m", "ngbrain", "mesh", str(path), "--route", "hull", "-o", str(made), "-q"],
            capture_output=True,
            text=True,
            check=False,
        )
        used = round(_children() - before, 1)
        found: Record = {"mesh_exit": done.returncode, "mesh_cpu_s": used}  # labels are in the cache
        if done.returncode or not made.exists():
            return found | {"mesh_reason": (done.stderr.strip().splitlines() or [""])[-1][:300]}
        mesh = meshio.read(made)
        regions = json.loads(made.with_name("result.json").read_text())["regions"]
    for name, region in regions.items():
        if name in ("brain", "ventricles"):
            found[f"mesh_{name}_off"] = round(region["volume_ml"] / region["label_volume_ml"] - 1, 5)
    tets = np.concatenate([block.data for block in mesh.cells if block.type == "tetra"])
    return found | {"tetrahedra": len(tets), "smallest_dihedral_deg": round(smallest_dihedral(mesh.points, tets), 1)}


def smallest_dihedral(points: np.ndarray, tets: np.ndarray) -> float:
    """Smallest angle (degrees) between two faces of a tetrahedron."""
    x = points[tets]
    normals = []
    for i in range(4):
        a, b, c = (x[:, j] for j in range(4) if j != i)
        normal = np.cross(b - a, c - a)
        normal *= np.sign(np.einsum("ij,ij->i", normal, a - x[:, i]))[:, None]
        normals.append(normal / np.linalg.norm(normal, axis=1)[:, None])
    cosines = [-(normals[i] * normals[j]).sum(axis=1) for i in range(4) for j in range(i)]
    return float(np.degrees(np.arccos(np.clip(cosines, -1, 1)).min()))


def _children() -> float:
    """CPU seconds of processes that were started and have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return float(used.ru_utime + used.ru_stime)


def table(records: list[Record]) -> str:
    """Records as Markdown: a line a head, then medians and worst values."""
    columns = {
        "head": "head",
        "labels CPU s": "cpu_s",
        "brain ml": "brain_ml",
        "ventricles ml": "ventricles_ml",
        "contrast": "contrast",
        "grey": "dice_grey",
        "white": "dice_white",
        "ventricles": "dice_ventricles",
        "brain": "dice_brain",
        "ceiling grey": "ceiling_grey",
        "ceiling white": "ceiling_white",
        "smallest dihedral": "smallest_dihedral_deg",
        "brain off": "mesh_brain_off",
        "ventricles off": "mesh_ventricles_off",
        "mesh CPU s": "mesh_cpu_s",
    }
    columns = {title: key for title, key in columns.items() if any(key in record for record in records)}
    lines = ["| " + " | ".join([*columns, "note"]) + " |", "|" + "---|" * (len(columns) + 1)]
    for record in records:
        notes = [record.get("reason", ""), record.get("mesh_reason", ""), *record.get("warnings", [])]
        cells = [str(record.get(key, "")) for key in columns.values()]
        lines.append("| " + " | ".join([*cells, "; ".join(filter(None, notes))]) + " |")
    seen = [record for record in records if record["recognised"]]
    lines.append(f"\nRecognised: {len(seen)} of {len(records)}.")
    if any("mesh_exit" in record for record in records):
        lines[-1] += f" Meshed: {sum(record.get('mesh_exit') == 0 for record in seen)} of those."
    for name in ("grey", "white", "ventricles"):
        scores = [record[f"dice_{name}"] for record in seen if f"dice_{name}" in record]
        if scores:
            lines.append(f"Dice of {name}: median {np.median(scores):.3f}, worst {min(scores):.3f}.")
        if shares := [r[f"dice_{name}"] / r[f"ceiling_{name}"] for r in seen if f"ceiling_{name}" in r]:
            lines[-1] += f" Of the ceiling: median {np.median(shares):.3f}, worst {min(shares):.3f}."
    return "\n".join(lines)


def main() -> None:
    """Measure a folder, or write the table of what was measured."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", nargs="?", type=Path)
    parser.add_argument("--mesh", action="store_true")
    parser.add_argument("--table", action="store_true")
    add_executor(parser)
    arguments = parser.parse_args()
    if arguments.table:
        print(table(json.load(sys.stdin)))
        return
    if arguments.folder is None or not arguments.folder.is_dir():
        parser.error("FOLDER: a folder of T1s")
    paths = [p for p in sorted(arguments.folder.iterdir()) if p.name.endswith(ENDINGS) and "_labels" not in p.name]
    heads = {path.name: (path, arguments.mesh) for path in paths}
    with executor_of(parser, arguments.executor) as executor:
        records = sweep(anew, heads, executor, lambda record: print(record, file=sys.stderr, flush=True))
    made = run()
    print(json.dumps([record | {"run": made} for record in records], indent=1))


if __name__ == "__main__":
    main()
