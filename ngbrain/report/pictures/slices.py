"""Three slices of a scan through the target: tissue labels, and the mesh made from them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ngbrain.errors import InputError, require
from ngbrain.image.segment.tissue_classes import CSF, VENTRICLE, WHITE
from ngbrain.reading import read_npz
from ngbrain.report.pictures.frame import DeformedHead
from ngbrain.report.pictures.style import WIDTH, direction, figure, png, style
from ngbrain.report.render.surface import Floats, Ints, cut_surface

__all__ = ["ScanImage", "slices", "volumes"]

MARGIN = 9.0
"""Margin around head and mesh (mm)."""
GAP = 4.0
"""Gap between slices (mm)."""
VIEWS = (("Sagittal", 0, 1, 2, "the left"), ("Coronal", 1, 0, 2, "the front"), ("Axial", 2, 0, 1, "below"))
"""Name; normal axis of the plane; axis that points to the picture's left; axis that points up; viewing side."""
OUTLINE, BORDER, FLUID, CLEFT, TARGET = "#F0E442", "#FF8C1A", "#56B4E9", "#FF5CA8", "#FF2D2D"
TINT = 0.45
"""Opacity of the tint of cerebrospinal fluid outside the ventricles."""
DIM = 0.5
_CORNERS = np.array([[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]])


@dataclass(frozen=True, eq=False)
class ScanImage:
    """The scan of a head on cubic voxels along right, front and up.

    Parameters
    ----------
    t1 : ndarray, shape (nx, ny, nz)
        Grey values.
    labels : ndarray of uint8, shape (nx, ny, nz)
        0 outside, 1 CSF, 2 grey matter, 3 white matter, 4 ventricle.
    origin : ndarray, shape (3,)
        Centre of voxel (0, 0, 0) (m).
    spacing : float
        Voxel size (m).
    """

    t1: np.ndarray
    labels: np.ndarray
    origin: Floats
    spacing: float

    @classmethod
    def read(cls, folder: Path) -> ScanImage | None:
        """Read `folder/head.npz`; None without the file, as the head is then not from a scan.

        Raises `InputError` for a damaged file.
        """
        path = folder / "head.npz"
        if not path.exists():
            return None
        try:
            file = read_npz(path, "head")
            t1, labels, origin, spacing = (file[key] for key in ("t1", "labels", "origin_m", "spacing_m"))
        except (KeyError, InputError) as error:
            raise InputError("head", f"damaged ({error})", "the scan that ngbrain stored", path) from error
        fit = {
            "t1": t1.ndim == 3 and min(t1.shape) > 1 and t1.dtype.kind in "uif" and bool(np.isfinite(t1).all()),
            "labels": labels.shape == t1.shape and labels.dtype == np.uint8 and CSF <= labels.max() <= VENTRICLE,
            "origin_m": origin.shape == (3,) and origin.dtype.kind == "f" and bool(np.isfinite(origin).all()),
            "spacing_m": spacing.shape == () and spacing.dtype.kind == "f" and 0 < spacing < np.inf,
        }
        if not all(fit.values()):
            raise InputError(next(key for key in fit if not fit[key]), "damaged", "the scan that ngbrain stored", path)
        return cls(t1, labels, origin.astype(float), float(spacing))

    def centres(self, axis: int) -> Floats:
        """Voxel centres along an axis (mm)."""
        return np.asarray(1e3 * (self.origin[axis] + self.spacing * np.arange(self.t1.shape[axis])))

    def nearest(self, axis: int, position: float) -> int:
        """Number of the layer of voxels nearest to a position.

        Parameters
        ----------
        axis : int
            Axis.
        position : float
            Position along it (m).

        Returns
        -------
        int
            The layer.
        """
        return int(np.clip(np.rint((position - self.origin[axis]) / self.spacing), 0, self.t1.shape[axis] - 1))

    def extent(self, across: int, up: int) -> tuple[float, float, float, float]:
        """Outer edges of the first and last voxels along two axes.

        Parameters
        ----------
        across, up : int
            The axes.

        Returns
        -------
        tuple of float
            Left, right, bottom, top (mm).
        """
        half = 1e3 * self.spacing / 2
        (a, *_, b), (c, *_, d) = self.centres(across), self.centres(up)
        return float(a - half), float(b + half), float(c - half), float(d + half)


def slices(image: ScanImage, peak: DeformedHead) -> bytes:
    """Sagittal, coronal and axial slice through the target: above, the scan with its labels; below, with the undeformed mesh.

    The planes go through the voxel centres next to the target; scan, labels and mesh are cut by the same plane.

    Parameters
    ----------
    image : ScanImage
        The scan.
    peak : DeformedHead
        The head.

    Returns
    -------
    bytes
        A PNG.
    """
    with style():
        low, high = _bounds(image, peak)
        size = high - low
        widths = [size[across] for _, _, across, _, _ in VIEWS]
        tall = max(size[up] for _, _, _, up, _ in VIEWS)
        scale = WIDTH / (sum(widths) + (len(VIEWS) + 1) * GAP)  # inches per mm
        head, between, foot = 0.66, 0.46, 0.32
        height = head + between + foot + 2 * scale * tall
        page = figure(height)
        window = np.percentile(image.t1[image.labels > 0], [1, 99.7])
        handles: list[list[Any]] = [[], []]
        for row in range(2):
            bottom = foot + (1 - row) * (between + scale * tall)
            left = GAP * scale
            for (name, normal, across, up, seen), width in zip(VIEWS, widths, strict=True):
                box = (left / WIDTH, bottom / height, scale * width / WIDTH, scale * tall / height)
                left += scale * (width + GAP)
                axes = page.add_axes(box)
                layer = image.nearest(normal, peak.cleft.target[normal])
                where = image.centres(normal)[layer]
                grey = np.take(image.t1, layer, normal).T
                look = {"cmap": "gray", "vmin": window[0], "vmax": max(window[1], window[0] + 1e-9)}
                axes.imshow(grey, origin="lower", extent=image.extent(across, up), alpha=DIM if row else 1.0, **look)
                if row:
                    handles[1] = _mesh(axes, peak, 1e-3 * where, normal, [across, up])
                else:
                    handles[0] = _labels(axes, image, layer, normal, across, up)
                    place = f"{where:.1f}".replace("-", "−")
                    title = f"{name}, {'xyz'[normal]} = {place} mm, from {seen}"
                    page.text(box[0], box[1] + box[3] + 0.06 / height, title, ha="left", va="bottom", fontsize=9)
                middle = (low[up] + high[up]) / 2
                axes.set(xlim=(high[across], low[across]), ylim=(middle - tall / 2, middle + tall / 2))
                _decorate(axes, peak, across, up)
        target = _line(TARGET, "target", ls="", marker="o", ms=4)
        for row, text in enumerate(("Scan (T1) and labels", "Undeformed mesh on the scan")):
            top = (foot + (2 - row) * scale * tall + (1 - row) * between) / height
            lift = 0.30 if row == 0 else 0.08
            page.text(
                GAP * scale / WIDTH, top + (lift + 0.06) / height, text, va="bottom", fontsize=10.5, weight="bold"
            )
            page.legend(
                handles=[*handles[row], target], loc="lower right", bbox_to_anchor=(1 - GAP * scale / WIDTH, top + lift / height),
                ncols=len(handles[row]) + 1, fontsize=9.5, handlelength=1.4, columnspacing=1.3, borderpad=0.2,
                borderaxespad=0.0, facecolor="#333333", labelcolor="white", edgecolor="none", framealpha=1,
            )  # fmt: skip
        said = "Coronal and axial in radiological convention: the patient's right (R) is at the picture's left."
        page.text(GAP * scale / WIDTH, 0.1 / height, said, ha="left", va="bottom", fontsize=9.5)
        return png(page)


def volumes(head: Mapping[str, Any], model: Mapping[str, Any]) -> list[tuple[str, float | None, float | None]]:
    """Volumes by labels and by mesh, for the regions that the mesh distinguishes.

    Parameters
    ----------
    head : mapping of str to Any
        The `head` of a result.
    model : mapping of str to Any
        The `model` of a result.

    Returns
    -------
    list of tuple
        Name, volume by the scan's labels (ml), volume of the mesh (ml); empty without labels.

    Examples
    --------
    >>> volumes({"label_volumes_ml": {"csf": 90.0, "grey": 600.0, "ventricle": 30.0}}, {"brain_ml": 688.0})
    [('brain: csf, grey', 690.0, 688.0), ('ventricles', 30.0, None)]
    """
    labels = head.get("label_volumes_ml") or {}
    fluid = [name for name in labels if name.startswith("ventricle")]
    solid = [name for name in labels if name not in fluid]
    rows = ((f"brain: {', '.join(solid)}", solid, "brain_ml"), ("ventricles", fluid, "ventricles_ml"))
    return [(text, sum(labels[name] for name in of), head.get(key, model.get(key))) for text, of, key in rows if of]


def _bounds(image: ScanImage, peak: DeformedHead) -> tuple[Floats, Floats]:
    """Corners (mm) of the picture: head, mesh and a margin."""
    filled = np.argwhere(image.labels > 0)
    corners = np.stack([filled.min(axis=0), filled.max(axis=0)]) * image.spacing + image.origin
    every = 1e3 * np.concatenate([corners, peak.rest])
    return every.min(axis=0) - MARGIN, every.max(axis=0) + MARGIN


def _labels(axes: Any, image: ScanImage, layer: int, normal: int, across: int, up: int) -> list[Any]:
    """Draw outlines of the labels and tint the fluid outside the ventricles; returns legend entries."""
    colors, patches = (require(f"matplotlib.{name}", "report") for name in ("colors", "patches"))
    label = np.take(image.labels, layer, normal).T
    at = image.centres(across), image.centres(up)
    kinds = (
        (label >= WHITE, BORDER, 0.6, "grey/white boundary"),
        (label > 0, OUTLINE, 1.0, "brain's outline"),
        (label == VENTRICLE, FLUID, 1.0, "ventricles"),
    )
    for inside, colour, width, _ in kinds:
        if inside.any() and not inside.all():
            axes.contour(*at, inside.astype(float), [0.5], colors=colour, linewidths=width)
    fluid = np.zeros((*label.shape, 4))
    fluid[label == CSF] = colors.to_rgba(FLUID, TINT)
    axes.imshow(fluid, origin="lower", extent=image.extent(across, up), interpolation="nearest")
    tint = patches.Patch(color=FLUID, alpha=TINT, label="other CSF")
    return [*(_line(colour, text, lw=1.6) for _, colour, _, text in kinds), tint]


def _mesh(axes: Any, peak: DeformedHead, where: float, normal: int, flat: list[int]) -> list[Any]:
    """Draw the elements' edges in the plane and the mesh's surfaces; returns legend entries."""
    elements = np.unique(np.sort(peak.tets[:, _CORNERS].reshape(-1, 3), axis=1), axis=0)
    none = np.zeros((0, 3), int)
    kinds: tuple[tuple[Ints, str, float, str], ...] = (
        (elements, "#BFE3CF", 0.35, "elements"),
        (np.concatenate([peak.skull(), peak.window()]), OUTLINE, 1.3, "outer surface"),
        (peak.ventricles(), FLUID, 1.3, "ventricle wall"),
        (np.concatenate([none, *peak.cleft_faces().values()]), CLEFT, 1.5, "cleft"),
    )
    collections = require("matplotlib.collections", "report")
    for tris, colour, width, _ in kinds:
        cut = cut_surface(tris, peak.rest[:, normal] - where)
        lines = 1e3 * cut.interpolate(peak.rest[:, flat])[cut.simplices]
        axes.add_collection(
            collections.LineCollection(lines, colors=colour, linewidths=width, capstyle="round"), autolim=False
        )
    return [_line(colour, text, lw=max(width, 0.8)) for _, colour, width, text in kinds]


def _decorate(axes: Any, peak: DeformedHead, across: int, up: int) -> None:
    """Draw target, orientation letters and scale bar."""
    axes.set_facecolor("black")
    axes.tick_params(left=False, bottom=False, labelleft=False, labelbottom=False)
    for spine in axes.spines.values():
        spine.set_visible(False)
    x, y = 1e3 * peak.cleft.target[[across, up]]
    axes.plot(x, y, "o", color=TARGET, ms=3.5, zorder=10)
    a, b = np.eye(3)[across], np.eye(3)[up]
    for v, at in ((a, (0.03, 0.5)), (-a, (0.97, 0.5)), (b, (0.5, 0.975)), (-b, (0.5, 0.025))):
        look = {"ha": "center", "va": "center", "fontsize": 10, "fontweight": "bold", "color": "white"}
        axes.text(*at, direction(v), transform=axes.transAxes, **look)
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    x, y = left + 0.05 * (right - left), bottom + 0.025 * (top - bottom)
    axes.plot([x, x - 20], [y, y], color="white", lw=2.5, solid_capstyle="butt")  # x decreases to the right
    axes.text(x - 10, y + 0.015 * (top - bottom), "20 mm", ha="center", va="bottom", fontsize=9, color="white")


def _line(colour: str, text: str, **look: Any) -> Any:
    return require("matplotlib.lines", "report").Line2D([], [], color=colour, label=text, **look)
