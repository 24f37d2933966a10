"""Slices of a synthetic scan: positions in the picture, and invalid files."""

import io
import json
import re
from pathlib import Path

import netgen.occ as occ
import ngsolve as ng
import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.image import imread

from ngbrain.errors import InputError
from ngbrain.io import Frame, QuadraticGrid, save
from ngbrain.mesh import Cleft
from ngbrain.report.pages.retraction import build
from ngbrain.report.pictures import animation, figures, slices, style
from ngbrain.report.pictures.frame import DeformedHead
from ngbrain.report.pictures.slices import ScanImage, volumes
from ngbrain.report.render.surface import faces, triangles

SPACING = 4e-3
ORIGIN = np.array([-0.078, -0.098, -0.066])  # m, centre of the first voxel
SHAPE = (40, 50, 34)
LOW, HIGH = (-0.06, -0.08, -0.048), (0.06, 0.08, 0.048)  # of head and mesh, m
TARGET = np.array([0.01, 0.0, 0.0])
ELSEWHERE = (-0.03, -0.03, -0.03)  # off all three planes
GEOMETRY = {
    "target_m": TARGET.tolist(),
    "out": [0.0, 0.0, 1.0],
    "across": [1.0, 0.0, 0.0],
    "depth_m": 0.048,
    "opening_m": 0.004,
    "width_m": 0.01,
    "craniotomy_m": 0.04,
    "blade": {"width_m": 0.01},
}


def scan(mark: tuple[float, float, float] = ELSEWHERE) -> dict[str, np.ndarray]:
    """Box of grey matter, white within, a ventricle in the middle; a dark cube of 12 mm about `mark` (m)."""
    at = np.stack(np.meshgrid(*(o + SPACING * np.arange(n) for o, n in zip(ORIGIN, SHAPE, strict=True)), indexing="ij"))
    depth = np.min(np.array(HIGH)[:, None, None, None] - abs(at), axis=0)
    labels = np.select([depth < 0, depth < 6e-3, depth < 14e-3, depth < 42e-3], [0, 1, 2, 3], 4).astype(np.uint8)
    t1 = np.choose(labels, [0, 20, 60, 90, 20]).astype(np.float32)
    t1[np.max(abs(at - np.reshape(mark, (3, 1, 1, 1))), axis=0) < 7e-3] = 0
    return {"t1": t1, "labels": labels, "origin_m": ORIGIN, "spacing_m": np.array(SPACING)}


def image_of(arrays: dict[str, np.ndarray]) -> ScanImage:
    return ScanImage(arrays["t1"], arrays["labels"], arrays["origin_m"], float(arrays["spacing_m"]))


@pytest.fixture(scope="module")
def grid() -> QuadraticGrid:
    outer, inner = occ.Box(LOW, HIGH), occ.Box((-0.02, -0.04, -0.01), (0.02, 0.04, 0.01))
    outer.faces.name = "skull"
    outer, inner = outer - inner, inner.mat("ventricles")
    outer.mat("brain")
    return QuadraticGrid(ng.Mesh(occ.OCCGeometry(occ.Glue([outer, inner])).GenerateMesh(maxh=0.04)))


@pytest.fixture(scope="module")
def peak(grid: QuadraticGrid) -> DeformedHead:
    tets = grid.connectivity
    cleft = Cleft(TARGET, np.array([0, 0, 1.0]), np.array([1.0, 0, 0]), 0.048, 0.004, 0.01)
    regions = np.array(grid.region_names)[grid.region]
    outer = {"skull": faces(tets)}
    return DeformedHead(
        "a",
        0.0,
        grid.points,
        grid.points,
        0 * grid.points[:, 0],
        tets,
        regions,
        outer,
        triangles(outer["skull"]),
        cleft,
        0.04,
        "blade",
        (),
    )


def picture(arrays: dict[str, np.ndarray], peak: DeformedHead) -> np.ndarray:
    return np.asarray(imread(io.BytesIO(slices.slices(image_of(arrays), peak)), format="png"))[..., :3]


@pytest.fixture(scope="module")
def plain(peak: DeformedHead) -> np.ndarray:
    return picture(scan(), peak)


def places(shown: np.ndarray, wanted: np.ndarray, view: int, row: int) -> tuple[np.ndarray, float]:
    """Positions (k, 2) in mm right and up from the centre of a slice of the selected pixels, and pixels per mm."""
    wide, tall = np.array([160, 120, 120]) + 2 * slices.MARGIN, 160 + 2 * slices.MARGIN
    scale = shown.shape[1] / (wide.sum() + 4 * slices.GAP)
    left = slices.GAP * (view + 1) + wide[:view].sum()
    black = (shown[:, round((left + 1) * scale)] < 0.02).all(axis=-1)
    ends = np.flatnonzero(np.diff(np.r_[False, black, False].astype(int))).reshape(-1, 2)
    top, bottom = ends[ends[:, 1] - ends[:, 0] > 100][row]
    assert (bottom - top) / scale == pytest.approx(tall, abs=1)
    y, x = np.nonzero(wanted[top:bottom, round(left * scale) : round((left + wide[view]) * scale)])
    return np.column_stack([x + 0.5 - wide[view] * scale / 2, (bottom - top) / 2 - y - 0.5]) / scale, scale


def test_extent_and_layers_by_hand() -> None:
    image = image_of(scan())
    assert image.extent(0, 2) == pytest.approx((-80, 80, -68, 68))  # half a voxel beyond the first and last centres
    assert image.extent(1, 0) == pytest.approx((-100, 100, -80, 80))
    assert image.centres(2)[[0, -1]] == pytest.approx([-66, 66])
    assert [image.nearest(2, z) for z in (-1, -66e-3, -63.9e-3, 0.5e-3, 1)] == [0, 0, 1, 17, 33]


def test_the_picture_is_three_slices_wide_and_two_rows_high(plain: np.ndarray) -> None:
    assert plain.shape[1] == style.WIDTH * style.DPI
    black = (plain < 0.02).all(axis=-1)
    columns, rows = black.mean(axis=0) > 0.2, black.mean(axis=1) > 0.05
    assert np.count_nonzero(np.diff(columns.astype(int)) == 1) >= 3
    assert np.count_nonzero(np.diff(rows.astype(int)) == 1) >= 2


@pytest.mark.parametrize("row", [0, 1])
@pytest.mark.parametrize(
    ("view", "mark", "right", "up"),
    [  # mm from the head's middle: front and right are on the picture's left
        (0, (0.01, 0.05, 0.03), -50, 30),
        (0, (0.01, -0.03, -0.03), 30, -30),
        (1, (0.042, 0.0, 0.03), -42, 30),
        (2, (-0.042, 0.05, 0.0), 42, 50),
    ],
)
def test_a_dark_spot_is_where_radiologists_look_for_it(
    peak: DeformedHead,
    plain: np.ndarray,
    row: int,
    view: int,
    mark: tuple[float, float, float],
    right: float,
    up: float,
) -> None:
    """The spot is found by the difference from a scan with another one; its position is relative to the slice's centre."""
    with_it = picture(scan(mark), peak)
    changed = np.abs(with_it - plain).max(axis=-1) > 0.1
    at, scale = places(with_it, changed, view, row)
    assert len(at) > 0.5 * (12 * scale) ** 2
    assert (at.min(axis=0) + at.max(axis=0)) / 2 == pytest.approx([right, up], abs=1)


@pytest.mark.parametrize(("view", "half"), [(0, (80, 48)), (1, (60, 48)), (2, (60, 80))])
def test_the_outlines_of_labels_and_mesh_lie_on_the_head(
    plain: np.ndarray, view: int, half: tuple[float, float]
) -> None:
    for row in range(2):
        at, _ = places(plain, np.abs(plain - to_rgb(slices.OUTLINE)).max(axis=-1) < 0.15, view, row)
        assert np.r_[-at.min(axis=0), at.max(axis=0)] == pytest.approx([*half, *half], abs=1)


def test_volumes_of_labels_stand_beside_those_of_the_mesh() -> None:
    labels = {"csf": 300.0, "grey": 700.0, "white": 500.0, "ventricle": 30.0}
    head = {"label_volumes_ml": labels, "brain_ml": 1490.0, "ventricles_ml": 29.0}
    assert volumes(head, {}) == [("brain: csf, grey, white", 1500.0, 1490.0), ("ventricles", 30.0, 29.0)]
    assert volumes({}, {"brain_ml": 3.0}) == []


SECTIONS = ("The head and the opening", "Scan, tissues and mesh", "Pressure over time")


@pytest.fixture
def run(tmp_path: Path, grid: QuadraticGrid, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A result folder; other pictures are not drawn."""
    for name in ("head", "strain_slice"):
        monkeypatch.setattr(figures, name, lambda *_: b"none")
    monkeypatch.setattr(animation, "animation", lambda *_: animation.Animation([], 0, b"", []))
    monkeypatch.setattr(style, "DPI", 50)
    zero = {"displacement": 0 * grid.points, "max_principal_strain": 0 * grid.points[:, 0]}
    save(tmp_path / "a.vtkhdf", grid, [Frame(0.0, zero)])
    series = {"t_s": [0.0, 1.0], "opening_mm": [0.0, 1.0], "blade_mm": [0.0, 1.0], "pressure_mmHg": [0.0, 9.0]}
    head = {"source": "a made-up <scan>", "label_volumes_ml": {"grey": 1234.4, "ventricle": 6.0}, "brain_ml": 1230.0}
    result = {"answers": {"a": {"series": series, "mps_p99": 0.2}}, "geometry": GEOMETRY, "head": head}
    (tmp_path / "result.json").write_text(json.dumps(result))
    return tmp_path


def test_a_head_from_a_scan_has_its_section(run: Path) -> None:
    np.savez_compressed(run / "head.npz", **scan())
    page = build(run).read_text(encoding="utf-8")
    assert page.count("<img") == 4
    order = [page.index(f">{title}</h2>") for title in SECTIONS]
    assert order == sorted(order)
    text = re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", page))
    assert "Sulcal CSF inside the hull takes grey matter's law. The head: a made-up &lt;scan&gt;." in text
    assert "brain: grey 1 234 1 230" in text


def test_a_scan_without_more_words_has_its_section_too(run: Path) -> None:
    result = json.loads((run / "result.json").read_text())
    del result["head"]
    (run / "result.json").write_text(json.dumps(result))
    np.savez(run / "head.npz", **scan())
    page = build(run).read_text(encoding="utf-8")
    assert page.count("<img") == 4
    assert "The head: " not in page
    assert "Labels (ml)" not in page


def test_a_head_without_a_scan_has_none(run: Path) -> None:
    assert ScanImage.read(run) is None
    page = build(run).read_text(encoding="utf-8")
    assert page.count("<img") == 3
    assert "Scan, tissues" not in page


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("t1", None),
        ("t1", np.zeros((3, 4))),
        ("t1", np.full(SHAPE, np.nan)),
        ("t1", np.array(["a"])),
        ("labels", np.zeros((2, 2, 2), np.uint8)),
        ("labels", np.zeros(SHAPE, np.uint8)),
        ("labels", np.full(SHAPE, 7, np.uint8)),
        ("origin_m", np.zeros(2)),
        ("spacing_m", np.array(0.0)),
        ("spacing_m", np.array([1e-3, 1e-3, 2e-3])),
    ],
)
def test_a_scan_with_wrong_contents_is_refused(tmp_path: Path, key: str, value: np.ndarray | None) -> None:
    arrays = scan()
    arrays.pop(key) if value is None else arrays.update({key: value})
    np.savez(tmp_path / "head.npz", **arrays)
    with pytest.raises(InputError) as error:
        ScanImage.read(tmp_path)
    assert "head.npz" in str(error.value)
    assert key in str(error.value)


@pytest.mark.parametrize("way", ["short", "flipped", "empty", "text", "pickled", "folder"])
def test_a_damaged_file_is_refused(tmp_path: Path, way: str) -> None:
    path = tmp_path / "head.npz"
    if way == "pickled":
        np.savez(path, **{**scan(), "t1": np.array([{}], object)})
    elif way == "folder":
        path.mkdir()
    else:
        np.savez_compressed(path, **scan())
        data = bytearray(path.read_bytes())
        data[200:204] = bytes(255 - b for b in data[200:204])
        whole = path.read_bytes()
        path.write_bytes({"short": whole[:-300], "flipped": bytes(data), "empty": b"", "text": b"no scan"}[way])
    with pytest.raises(InputError) as error:
        ScanImage.read(tmp_path)
    assert "head.npz" in str(error.value)
    assert "\n" not in str(error.value)


def test_a_damaged_scan_stops_the_report(run: Path) -> None:
    (run / "head.npz").write_bytes(b"PK")
    with pytest.raises(InputError):
        build(run)
    assert not (run / "report.html").exists()
