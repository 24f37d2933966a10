"""A protocol's run, interpolated in time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import ngsolve as ngs
import numpy as np

from ngbrain.errors import InputError
from ngbrain.io import Frame, QuadraticGrid, load
from ngbrain.mesh import Cleft
from ngbrain.report.pictures.frame import DeformedHead, smooth_folded_strain
from ngbrain.report.pictures.tool import TOOLS, tool_drawings
from ngbrain.report.render.surface import Floats, Ints, faces, triangles


@dataclass(frozen=True, eq=False)
class Run:
    """The frames of a protocol's file, and its constant data.

    Parameters
    ----------
    protocol : str
        Name of the protocol.
    grid : QuadraticGrid
        The mesh.
    frames : list of Frame
        Frames in order of time, with displacement and max_principal_strain.
    peak_time : float
        Time of the largest strain (s).
    outer, borders
        As in `DeformedHead`.
    cleft : Cleft
        The cleft.
    craniotomy : float
        Diameter of the craniotomy (m).
    blade : mapping of str to Any
        `geometry.blade` of a result.
    advance : tuple of ndarray
        Times (s) and advance of the blade (m).
    """

    protocol: str
    grid: QuadraticGrid
    frames: list[Frame]
    peak_time: float
    outer: dict[str, Ints]
    borders: Ints
    cleft: Cleft
    craniotomy: float
    blade: Mapping[str, Any]
    advance: tuple[Floats, Floats]

    @classmethod
    def read(cls, folder: Path, protocol: str, geometry: Mapping[str, Any], answer: Mapping[str, Any]) -> Run:
        """Read `folder/PROTOCOL.vtkhdf`.

        Parameters
        ----------
        folder : Path
            Folder of the result.
        protocol : str
            Name of the protocol.
        geometry : mapping of str to Any
            `geometry` of the result.
        answer : mapping of str to Any
            Answers of the protocol.

        Returns
        -------
        Run
            The run.

        Raises
        ------
        InputError
            The file is missing, damaged or has no frames of displacement and strain.
        """
        path = folder / f"{protocol}.vtkhdf"
        checkpoint = load(path)
        frames = [f for f in checkpoint.frames if {"displacement", "max_principal_strain"} <= set(f.point_data)]
        if not frames:
            raise InputError("frames", "without displacement and max_principal_strain", "a run of ngbrain", file=path)
        when = answer.get("strain_peak_at_s", (checkpoint.state.get("peak") or {}).get("t"))
        if when is None:
            when = max(frames, key=lambda f: float(np.percentile(f.point_data["max_principal_strain"], 99))).time
        grid, series = checkpoint.grid, answer["series"]
        target, out, across = (np.array(geometry[key], float) for key in ("target_m", "out", "across"))
        depth, opening, width = (float(geometry[key]) for key in ("depth_m", "opening_m", "width_m"))
        return cls(
            protocol,
            grid,
            frames,
            float(when),
            _named(grid.mesh, faces(grid.connectivity)),
            triangles(faces(grid.connectivity, np.array(grid.region_names)[grid.region])),
            Cleft(target, out, across, depth, opening, width),
            float(geometry["craniotomy_m"]),
            geometry["blade"],
            (np.array(series["t_s"], float), 1e-3 * np.array(series["blade_mm"], float)),
        )

    @property
    def times(self) -> Floats:
        """Times of the frames (s)."""
        return np.array([frame.time for frame in self.frames])

    def peak(self) -> DeformedHead:
        """The frame nearest to the time of the largest strain."""
        return self.frame_at(min(self.times, key=lambda t: abs(t - self.peak_time)))

    def frame_at(self, t: float) -> DeformedHead:
        """Interpolate linearly between frames at a time (s); constant before the first and after the last frame.

        The blade moves piecewise linearly with a frame at each end, so that its position is exact between frames.
        """
        t = float(np.clip(t, self.times[0], self.times[-1]))
        after = int(np.searchsorted(self.times, t))
        before = after - int(self.times[after] > t)
        span = self.times[after] - self.times[before]
        share = (t - self.times[before]) / span if span else 0.0

        def between(name: str) -> Floats:
            first, second = (np.asarray(self.frames[k].point_data[name], float) for k in (before, after))
            return first + share * (second - first)

        grid = self.grid
        points = grid.points + between("displacement")
        return DeformedHead(
            self.protocol,
            t,
            points,
            grid.points,
            smooth_folded_strain(grid.connectivity, grid.points, points, between("max_principal_strain")),
            grid.connectivity,
            np.array(grid.region_names)[grid.region],
            self.outer,
            self.borders,
            self.cleft,
            self.craniotomy,
            TOOLS[self.blade.get("kind", "spatula")],
            tool_drawings(self.blade, self.cleft, float(np.interp(t, *self.advance))),
        )


def _named(mesh: ngs.Mesh, outer: Ints) -> dict[str, Ints]:
    """Faces of the outer surface by boundary name."""
    names = {tuple(sorted(v.nr for v in element.vertices)): element.mat for element in mesh.Elements(ngs.BND)}
    corners = np.sort(outer[:, :3], axis=1)
    found = np.array([names.get(tuple(map(int, row)), "surface") for row in corners])
    return {str(name): outer[found == name] for name in sorted(set(found))}
