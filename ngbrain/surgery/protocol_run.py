"""One protocol from rest to end, with a checkpoint after every step and a record for the report."""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ngbrain.errors import InputError
from ngbrain.forward.common.material import Material
from ngbrain.forward.contact.rigid import RigidContact
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.statics.stability import CREASE
from ngbrain.forward.transient.step_control import Control, StepperProgress
from ngbrain.forward.transient.time_stepper import TimeStepper
from ngbrain.io import Checkpoint, Frame, QuadraticGrid, load, save
from ngbrain.io.labelled_arrays import series
from ngbrain.look import BriefText, curves
from ngbrain.parallel import Callback
from ngbrain.result import Result, Status
from ngbrain.solvers.record import NewtonRecord
from ngbrain.surgery.measures.injury import MPS_THRESHOLDS
from ngbrain.surgery.measures.observer import UNITS, Observer, StepRecord, swept_volume, volume_change
from ngbrain.surgery.measures.sampling import MeasureStatistics, Sampler, TissueSample
from ngbrain.surgery.model import TISSUE, RetractionModel
from ngbrain.surgery.protocols import ForceProtocol, ToolMotion
from ngbrain.tensors import deformation_gradient, right_cauchy_green
from ngbrain.units import to_ml, to_mmHg

FRAME_SPACING = 1 / 12
"""A frame is stored at events and at least once in this fraction of the run."""
FRAME_WAY = 1 / 4
"""A frame is also stored when the advance or the force has changed by this fraction of its maximum."""
LARGEST = ("von_mises", "rate")
"""Measures (`TissueSample.statistics`) that are stored at the step where their own 95th percentile is largest."""

VOLUMES = {
    "window": (1, swept_volume("craniotomy")),
    "cleft": (1, swept_volume("wall_.*|end_.*|floor")),
    "ventricles": (-1, volume_change("ventricle.*")),
    "compression": (-1, volume_change(TISSUE)),
}
"""Volume changes at the peak: outflow through the craniotomy and into the cleft, loss of the ventricles and of the tissue."""

Snapshot = tuple[dict[str, Any], list[Frame]]
"""State from which a run can continue, and the frames stored so far."""


@dataclass(repr=False)
class Peak(BriefText):
    """Tissue state at the step with the largest 95th percentile of maximum principal strain.

    Parameters
    ----------
    t : float
        Time (s).
    mps, oss : MeasureStatistics
        Maximum principal and octahedral shear strain near the site.
    volume_mps_above : dict
        Threshold → tissue name → volume (ml).
    beyond_fit : dict
        Tissue name → volume (ml) strained beyond the data that its law was fitted to.
    creased : dict
        Tissue name → volume (ml) compressed beyond `forward.statics.stability.CREASE`, where free surfaces fold.
    tissue, near : dict
        Tissue name → volume (ml) in total, and near the site.
    volume : dict
        Volume changes (ml), see `VOLUMES`.
    """

    t: float
    mps: MeasureStatistics
    oss: MeasureStatistics
    volume_mps_above: dict[str, dict[str, float]]
    beyond_fit: dict[str, float]
    creased: dict[str, float]
    tissue: dict[str, float]
    near: dict[str, float]
    volume: dict[str, float]

    @classmethod
    def from_sample(cls, sample: TissueSample, spreads: dict[str, MeasureStatistics], volume: dict[str, float]) -> Peak:
        """From a tissue sample, its statistics and the volume changes (ml)."""
        sites, mps = sample.sites, sample.strain.mps
        everywhere = np.ones(len(mps), bool)
        near = np.zeros_like(everywhere)
        near[sites.near] = True
        return cls(
            sample.t,
            spreads["mps"],
            spreads["oss"],
            {f"{threshold:.2f}": sites.ml(mps > threshold) for threshold in MPS_THRESHOLDS},
            sites.ml(sample.beyond),
            sites.ml(sample.strain.stretch[:, 0] < CREASE),
            sites.ml(everywhere),
            sites.ml(near),
            volume,
        )

    @classmethod
    def from_dict(cls, saved: dict[str, Any]) -> Peak:
        """From `dataclasses.asdict`."""
        return cls(**{**saved, "mps": MeasureStatistics(**saved["mps"]), "oss": MeasureStatistics(**saved["oss"])})


@dataclass(repr=False, eq=False)
class ProtocolResult(Result):
    """Result of a protocol's run, small enough to pass between processes.

    Parameters
    ----------
    rows : dict of (n,) array
        Columns of `StepRecord` by name, SI units.
    events : tuple of float
        Times (s) at which the tool's rate changes, from first to last.
    peak : Peak
        Tissue state at the largest strain.
    largest : dict of MeasureStatistics
        Other measures at their own maximum.
    working_s : float
        Time (s) at full opening.
    steps, rejected, newton, factorisations : int
        Computational work, including that of a beginning shared with another protocol.
    """

    rows: dict[str, np.ndarray]
    events: tuple[float, ...]
    peak: Peak
    largest: dict[str, MeasureStatistics]
    working_s: float
    steps: int
    rejected: int
    newton: int
    factorisations: int

    def column(self, name: str) -> np.ndarray:
        """One column of the record."""
        return self.rows[name]

    @property
    def value(self) -> dict[str, float]:
        """The peaks of pressure and force."""
        return {
            "peak_pressure_mmHg": float(to_mmHg(self.column("pressure").max())),
            "peak_force_N": float(self.column("force").max()),
        }

    @property
    def statistics(self) -> dict[str, float]:
        """Computational work of its steps."""
        return {
            "time_steps": self.steps,
            "rejected": self.rejected,
            "Newton_iterations": self.newton,
            "factorisations": self.factorisations,
        }

    def plot(self) -> Any:
        """Pressure over time."""
        pressure = [float(to_mmHg(p)) for p in self.column("pressure")]
        return curves({"pressure": (self.column("t").tolist(), pressure)}, "time, s", "pressure, mmHg")

    def to_xarray(self) -> Any:
        """As `xarray.Dataset`: the columns of `StepRecord` along `time`, in SI units; raises `MissingExtra`."""
        columns = {
            "time" if name == "t" else name: (values, UNITS.get(name, "1"), name.replace("_", " "))
            for name, values in self.rows.items()
        }
        return series(columns, {"status": str(self.status), "events_s": list(self.events)})


class ProtocolRun:
    """A protocol on a model, with its record; `run` runs it and writes `FOLDER/NAME.vtkhdf` after every step.

    Parameters
    ----------
    model : RetractionModel
    protocol : ToolMotion or ForceProtocol
    folder : Path, optional
        Where the run file goes; None writes nothing.
    resume : bool
        Continue from the run file in the folder.
    start : Snapshot, optional
        State of another run to continue from.
    control : Control, optional
        Time-step control other than the scene's.
    materials : dict of Material, optional
        Materials other than the scene's.
    order : int, optional
        Order of the elements other than the scene's.
    """

    def __init__(
        self,
        model: RetractionModel,
        protocol: ToolMotion | ForceProtocol,
        folder: Path | None,
        resume: bool = False,
        start: Snapshot | None = None,
        control: Control | None = None,
        materials: dict[str, Material] | None = None,
        order: int | None = None,
    ) -> None:
        self.model, self.protocol = model, protocol
        self.path = None if folder is None else folder / f"{protocol.name}.vtkhdf"
        self.transient: TimeStepper = model.run(protocol, control, materials, order)
        body = self.transient.problem
        self._way = next(c.travel for c in body.contacts if isinstance(c, RigidContact) and c.travel)
        self.observer = Observer(body, model.blades, model.fixed)
        self.sampler = Sampler(body, model.cleft, model.parts(order))
        self._moving = {name: (sign, of.on(body)) for name, (sign, of) in VOLUMES.items()}
        self.rows: list[StepRecord] = []
        self.peak: Peak | None = None
        self.largest: dict[str, MeasureStatistics] = {}
        self.frames: list[Frame] = []
        self.grid = None if self.path is None else QuadraticGrid(model.mesh)
        if resume and self.path is not None and self.path.exists():
            self._restore(load(self.path))
        elif start is not None:
            self._load_state(*start)
        else:
            self.record_state(
                self.transient.problem, self.transient.progress, NewtonRecord(status=Status.CONVERGED, min_det_F=1.0)
            )

    def run(self, callback: Callback | None = None, until: float = float("inf")) -> ProtocolRun:
        """Run to the end.

        Parameters
        ----------
        callback : callable, optional
            Called with the protocol's name, the time (s) and the fraction done after every step.
        until : float, optional
            Time (s) at which to stop earlier.

        Returns
        -------
        ProtocolRun
            Itself. It raises what `TimeStepper.run` raises, with the last converged step saved.
        """
        end = self.protocol.times[-1]

        def watch(body: Problem, at: StepperProgress, record: NewtonRecord) -> None:
            self.record_state(body, at, record)
            if callback is not None:
                callback(self.protocol.name, at.t, at.t / end)

        self.transient.run(watch, until)
        return self

    def snapshot(self) -> Snapshot:
        """The present state, from which another protocol with the same beginning can continue."""
        return deepcopy(self._state()), list(self.frames)

    def result(self) -> ProtocolResult:
        """Result of a finished run."""
        assert self.peak is not None
        at = self.transient.progress
        work = (at.steps, at.rejected, at.newton, at.work.factorisations)
        parts = (to_columns(self.rows), self.protocol.times, self.peak, self.largest, self.protocol.working_s)
        return ProtocolResult(*parts, *work, status=Status.CONVERGED)

    def record_state(self, body: Problem, at: StepperProgress, record: NewtonRecord) -> None:
        """Record the present state of the problem.

        Parameters
        ----------
        body : Problem
        at : Progress
            Time and work of the stepper.
        record : NewtonRecord
            Of the step that has converged.
        """
        self.rows.append(self.observer(at.t, self._way.Get(), record.min_det_F))
        sample = self.sampler(at.t)
        spreads = sample.statistics()
        if self.peak is None or spreads["mps"].p95 > self.peak.mps.p95:
            self.peak = Peak.from_sample(sample, spreads, self._volumes())
        for name in LARGEST:
            self.largest[name] = max(
                self.largest.get(name, spreads[name]), spreads[name], key=lambda spread: spread.p95
            )
        if self.path is not None:
            self._save(body, at)

    def _volumes(self) -> dict[str, float]:
        """Volume changes (ml), see `VOLUMES`."""
        return {name: sign * to_ml(float(of.value()[0])) for name, (sign, of) in self._moving.items()}

    # The file.

    def _save(self, body: Problem, at: StepperProgress) -> None:
        assert self.grid is not None and self.path is not None and self.peak is not None
        frame = Frame(at.t, self._fields(body))
        keep = (
            not self.frames
            or at.rested
            or self.peak.t == at.t
            or is_frame_due(self.protocol, self.frames[-1].time, at.t)
        )
        more = {"scene": self.model.scene.to_dict(), "kept_frames": len(self.frames) + bool(keep)}
        save(self.path, self.grid, [*self.frames, frame], self._state() | more)
        if keep:
            self.frames.append(frame)

    def _state(self) -> dict[str, Any]:
        """Everything that the rest of the run depends on, and its record."""
        assert self.peak is not None
        return {
            "transient": self.transient.checkpoint(),
            "observer": self.observer.checkpoint(),
            "rows": to_columns(self.rows),
            "peak": asdict(self.peak),
            "largest": {name: asdict(spread) for name, spread in self.largest.items()},
        }

    def _fields(self, body: Problem) -> dict[str, np.ndarray]:
        """Displacement (m) and maximum principal strain at the nodes."""
        assert self.grid is not None
        C = self.grid.values(right_cauchy_green(deformation_gradient(body.u)), TISSUE).reshape(-1, 3, 3)
        C[np.trace(C, axis1=1, axis2=2) == 0] = np.eye(3)  # nodes inside the ventricles, which carry no tissue strain
        strain = (np.linalg.eigvalsh(C)[:, 2] - 1) / 2
        fields = {"displacement": self.grid.values(body.u), "max_principal_strain": strain}
        return {name: values.astype(np.float32) for name, values in fields.items()}

    def _restore(self, saved: Checkpoint) -> None:
        state = saved.state
        if state.get("scene") != self.model.scene.to_dict():
            raise InputError("--resume", str(self.path), "the scene that this file was written for, or another folder")
        try:
            self._load_state(state, saved.frames[: state["kept_frames"]])
        except (KeyError, ValueError, TypeError, IndexError, AttributeError) as error:
            found = f"{self.path}, which does not fit ({type(error).__name__}: {error})"
            raise InputError("--resume", found, "a run file as ngbrain wrote it, or another folder") from error

    def _load_state(self, state: dict[str, Any], frames: Sequence[Frame]) -> None:
        self.transient.restore(state["transient"])
        self.observer.restore(state["observer"])
        self.rows = [
            StepRecord(*values)
            for values in zip(*(state["rows"][name].tolist() for name in StepRecord.__annotations__), strict=True)
        ]
        self.peak = Peak.from_dict(state["peak"])
        self.largest = {name: MeasureStatistics(**spread) for name, spread in state["largest"].items()}
        self.sampler.start(self.transient.progress.t)
        self.frames = list(frames)


def is_frame_due(protocol: ToolMotion | ForceProtocol, last: float, t: float) -> bool:
    """Whether a frame is stored between events.

    Parameters
    ----------
    protocol : ToolMotion or ForceProtocol
    last : float
        Time (s) of the last frame.
    t : float
        Time (s) now.

    Returns
    -------
    bool
    """
    way = abs(protocol.value(t) - protocol.value(last))
    return t - last >= FRAME_SPACING * protocol.times[-1] or way >= FRAME_WAY * protocol.maximum


def to_columns(rows: list[StepRecord]) -> dict[str, np.ndarray]:
    """Records as columns, by field name."""
    return {name: np.array([getattr(row, name) for row in rows]) for name in StepRecord.__annotations__}
