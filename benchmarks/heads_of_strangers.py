"""Heads that were not used for tuning: success and quality of recognition, segmentation, meshing and simulated operation.

Runs over a folder of T1s: NIfTI, MGH, or a folder each of a DICOM series. A head NAME_t1.nii.gz may have a map of labels
NAME_muse_labels.nii.gz in the MUSE numbering on the same voxels; its tissues are then compared, and the ceiling is printed:
the Dice overlaps that the best thresholds inside MUSE's own grey and white matter reach, cerebrum and cerebellum apart, deep
grey matter given.

    python benchmarks/heads_of_strangers.py FOLDER [--measure WHAT ...] [--executor WHO] > records.json     a record a head
    python benchmarks/heads_of_strangers.py FOLDER [--measure WHAT ...] --into records.json   added to what is known of heads
    python benchmarks/heads_of_strangers.py --table < records.json         labels and meshes by hull as a table in Markdown

`_pages.py` makes the page of results.

WHAT is labels (which alone are measured by default); hull, lattice, conforming: the mesh by that route, its labels found
before; demo: `ngbrain demo --fast --no-checks` from an empty cache, whose results stay in the folder that --keep names.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
import warnings
from contextlib import suppress
from pathlib import Path

import meshio
import numpy as np
from _command import add_executor, executor_of, run, sweep

from ngbrain.errors import InputError, require
from ngbrain.image import CSF, GREY, VENTRICLE, WHITE, label_tissues, read_scan, resample_labels, template_affine
from ngbrain.io import write_json
from ngbrain.scene import Scene

Record = dict

LABELS, DEMO, ROUTES = "labels", "demo", ("hull", "lattice", "conforming")
ENDINGS = (".nii.gz", ".nii", ".mgz", ".mgh")
# Numbers of MUSE.
VENTRICLES = (4, 11, 49, 50, 51, 52)
WHITE_MATTER = (40, 41, *range(81, 96))
DEEP_GREY = (23, 30, 31, 32, 36, 37, 47, 48, *range(55, 61), 75, 76)
CEREBELLUM = (38, 39, 40, 41, 71, 72, 73)
LEFT_OUT = (1, 35, 61, 62)  # fluid outside, the brain stem


def anew(path: Path, wanted: list[str], keep: Path | None) -> Record:
    """Requested results of one head: numbers of its labels, and a record for each other item by name."""
    found: Record = {"head": path.name}
    with tempfile.TemporaryDirectory() as cache:
        os.environ["NGBRAIN_CACHE"] = cache
        if LABELS in wanted:
            found |= measure(path)
        elif set(wanted) & set(ROUTES):
            with suppress(InputError):  # which the mesh will say
                label_tissues(read_scan(path))
        found |= {route: meshed(path, route) for route in ROUTES if route in wanted}
    if DEMO in wanted:
        with tempfile.TemporaryDirectory() as cache:
            os.environ["NGBRAIN_CACHE"] = cache
            found[DEMO] = operated(path, keep / path.name.partition(".")[0] if keep else Path(cache, "demo"))
    return found


def measure(path: Path) -> Record:
    """Labels of one head."""
    found: Record = {"recognised": False}
    begun = time.process_time()
    try:
        scan = read_scan(path)
        found["voxel_mm"] = [round(1e3 * float(s), 2) for s in np.linalg.norm(scan.file_affine[:3, :3], axis=0)]
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            segmented = label_tissues(scan)
            labels, found["contrast"] = segmented.volume, round(segmented.contrast, 2)
        found["recognised"] = True
        found["warnings"] = sorted({str(each.message) for each in caught})
        found["cpu_s"] = round(time.process_time() - begun, 1)
    except InputError as error:
        return found | {"reason": plain(str(error), path)}
    counts = np.bincount(labels.data.ravel(), minlength=5) * labels.voxel_volume * 1e6
    found["brain_ml"] = round(float(counts[1:].sum()), 1)
    for name, label in (("csf", CSF), ("grey", GREY), ("white", WHITE), ("ventricles", VENTRICLE)):
        found[f"{name}_ml"] = round(float(counts[label]), 1)
    muse = path.with_name(path.name.replace("_t1.", "_muse_labels."))
    if muse != path and muse.exists():
        nibabel = require("nibabel", "mri")
        theirs = np.rint(np.asarray(nibabel.load(muse).dataobj)).astype(int)
        grey_values = np.asarray(nibabel.load(path).dataobj, float)
        found |= overlaps(resample_labels(labels, scan.file_affine, scan.file_shape).data, theirs, grey_values)
    return found


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


def meshed(path: Path, route: str) -> Record:
    """Record of `ngbrain mesh` with the route as the only option, for a head with cached labels."""
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder, "head.vtu")
        found, text = ngbrain("mesh", path, "--route", route, "-o", made, "-q")
        if found["exit"] or not made.exists():
            return found | {"reason": plain(text, path)}
        mesh = meshio.read(made)
        regions = json.loads(made.with_name("result.json").read_text())["regions"]
    found |= {f"{name}_off": round(of["volume_ml"] / of["label_volume_ml"] - 1, 5) for name, of in regions.items()}
    tets = np.concatenate([block.data for block in mesh.cells if block.type == "tetra"])
    return found | {"tetrahedra": len(tets), "smallest_dihedral_deg": round(smallest_dihedral(mesh.points, tets), 1)}


def operated(path: Path, folder: Path) -> Record:
    """Record of the fast demo on a head: position of the cleft, pressures and forces."""
    found, text = ngbrain(
        "demo", "--fast", "--no-checks", "--threads", "1", "--image", path, "-o", folder, "--overwrite"
    )
    found["report"] = (folder / "report.html").exists()
    if not (folder / "result.json").exists():
        return found | {"reason": plain(text, path)}
    return found | outcome(json.loads((folder / "result.json").read_text()), path)


def outcome(result: Record, path: Path) -> Record:
    """The main numbers of a demo's result; `place_off_mm` is how far the cleft's target lies, in the space of the template,
    from that of the demo on the template, by the affine registration of the brains."""
    head, model, geometry = result["head"], result["model"], result["geometry"]
    there = np.linalg.solve(template_affine(read_scan(path)), [*geometry["target_m"], 1.0])[:3]
    wanted = np.array(Scene.shipped("demo_fast").cleft.target)
    volumes = head["label_volumes_ml"]
    return {
        "brain_ml": round(head["label_brain_ml"] + volumes["ventricle"], 1),
        "ventricles_ml": round(volumes["ventricle"], 1),
        "brain_off": round(model["brain_ml"] / head["label_brain_ml"] - 1, 5),
        "ventricles_off": round(model["ventricles_ml"] / volumes["ventricle"] - 1, 5),
        "smallest_dihedral_deg": round(head["min_dihedral_deg"], 1),
        "tetrahedra": model["n_tets"],
        "target_mm": [round(1e3 * x, 1) for x in geometry["target_m"]],
        "target_in_template_mm": [round(1e3 * x, 1) for x in there],
        "place_off_mm": round(1e3 * float(np.linalg.norm(there - wanted)), 1),
        "depth_mm": round(1e3 * geometry["depth_m"], 1),
        "peak_pressure_mmHg": {name: round(a["peak_pressure_mmHg"], 1) for name, a in result["answers"].items()},
        "peak_force_N": {name: round(a["peak_force_N"], 2) for name, a in result["answers"].items()},
        "warnings": result["warnings"],
    }


def plain(text: str, path: Path) -> str:
    """A message without the names of the command and of the file."""
    return text.removeprefix("ngbrain: ").removeprefix(f"{path}: ")


def ngbrain(*arguments: str | Path) -> tuple[Record, str]:
    """Exit status, CPU seconds and memory of the command in a process of its own, and the last line that it wrote."""
    command = [sys.executable, "-m", "ngbrain", *map(str, arguments)]
    with tempfile.TemporaryFile("w+") as stream:
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=stream)
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        stream.seek(0)
        last = (stream.read().strip().splitlines() or [""])[-1][:300]
    cpu, memory = used.ru_utime + used.ru_stime, used.ru_maxrss / 2**20
    return {"exit": process.returncode, "cpu_s": round(cpu, 1), "peak_gib": round(memory, 2)}, last


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


def table(records: list[Record]) -> str:
    """Labels and meshes by hull as Markdown: a line a head, then medians and worst values."""
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
        "smallest dihedral": "hull_smallest_dihedral_deg",
        "brain off": "hull_brain_off",
        "ventricles off": "hull_ventricles_off",
        "mesh CPU s": "hull_cpu_s",
    }
    records = [
        record | {f"hull_{key}": value for key, value in record.get("hull", {}).items()}
        for record in records
        if "recognised" in record
    ]
    columns = {title: key for title, key in columns.items() if any(key in record for record in records)}
    lines = ["| " + " | ".join([*columns, "note"]) + " |", "|" + "---|" * (len(columns) + 1)]
    for record in records:
        notes = [record.get("reason", ""), record.get("hull_reason", ""), *record.get("warnings", [])]
        cells = [str(record.get(key, "")) for key in columns.values()]
        lines.append("| " + " | ".join([*cells, "; ".join(filter(None, notes))]) + " |")
    seen = [record for record in records if record["recognised"]]
    lines.append(f"\nRecognised: {len(seen)} of {len(records)}.")
    if any("hull" in record for record in records):
        lines[-1] += f" Meshed: {sum(record.get('hull_exit') == 0 for record in seen)} of those."
    for name in ("grey", "white", "ventricles"):
        scores = [record[f"dice_{name}"] for record in seen if f"dice_{name}" in record]
        if scores:
            lines.append(f"Dice of {name}: median {np.median(scores):.3f}, worst {min(scores):.3f}.")
        if shares := [r[f"dice_{name}"] / r[f"ceiling_{name}"] for r in seen if f"ceiling_{name}" in r]:
            lines[-1] += f" Of the ceiling: median {np.median(shares):.3f}, worst {min(shares):.3f}."
    return "\n".join(lines)


def main() -> None:
    """Measure a folder, or write tables of records."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", nargs="?", type=Path)
    parser.add_argument("--measure", nargs="+", choices=[LABELS, *ROUTES, DEMO], default=[LABELS], metavar="WHAT")
    parser.add_argument("--into", type=Path, metavar="JSON", help="a file of records that this run's are added to")
    parser.add_argument("--keep", type=Path, metavar="DIR", help="where the demos' results stay")
    parser.add_argument("--table", action="store_true")
    add_executor(parser)
    arguments = parser.parse_args()
    if arguments.table:
        print(table(json.load(sys.stdin)))
        return
    if arguments.folder is None or not arguments.folder.is_dir():
        parser.error("FOLDER: a folder of T1s")
    found = [path for path in sorted(arguments.folder.iterdir()) if path.name.endswith(ENDINGS) or path.is_dir()]
    paths = [path for path in found if "_labels" not in path.name]
    heads = {path.name: (path, arguments.measure, arguments.keep) for path in paths}
    made = run()
    before = json.loads(arguments.into.read_text()) if arguments.into and arguments.into.exists() else []
    known = {record["head"]: record for record in before}

    def finished(record: Record) -> None:
        print(record, file=sys.stderr, flush=True)
        parts = {what: part | {"run": made} for what, part in record.items() if what in (*ROUTES, DEMO)}
        labels = {"run": made} if LABELS in arguments.measure else {}
        known[record["head"]] = known.get(record["head"], {}) | record | labels | parts
        if arguments.into:
            write_json(arguments.into, list(known.values()))

    with executor_of(parser, arguments.executor) as executor:
        sweep(anew, heads, executor, finished)
    if not arguments.into:
        print(json.dumps(list(known.values()), indent=1))


if __name__ == "__main__":
    main()
