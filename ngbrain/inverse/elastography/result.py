"""The result of an inversion: maps, noise, checks and warnings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from ngbrain.adjoint.reduced import Reduced
from ngbrain.forward.common.solve_counts import Solves
from ngbrain.inverse.data.quality import (
    OctahedralShearStrain,
    RelativeNoise,
    noise_deviation,
    rms_noise,
)
from ngbrain.inverse.elastography.derived_maps import (
    DERIVED,
    map_statistics,
    maps_from_shear,
    shear_modulus_map,
    statistics_by_label,
)
from ngbrain.inverse.elastography.identifiability import (
    fibre_shear_moduli,
)
from ngbrain.inverse.elastography.usability import PATCHES, reasons_against
from ngbrain.inverse.optimise.result import Iteration
from ngbrain.inverse.problem.properties import MODULI
from ngbrain.inverse.problem.property_fields import property_fields
from ngbrain.inverse.problem.wave_problem import ElastographyProblem
from ngbrain.io.waves import WaveData
from ngbrain.io.waves.labelled import map_variables, wave_dataset
from ngbrain.look import BriefText
from ngbrain.look import maps as drawn
from ngbrain.result import Result

Array = np.ndarray


@dataclass(repr=False)
class StartResult(BriefText):
    """Result from one start.

    Parameters
    ----------
    name : str
        Name of the start.
    maps : dict of str to numpy.ndarray
        Property → (n,)
    misfit, expected : float
        Misfit and its expected value.
    value : float
        Objective J.
    history : list of Iteration
        The iterations.
    cpu_s : float
        CPU time, s.
    converged : bool
        Whether fields and weights converged.
    """

    name: str
    maps: dict[str, Array]
    misfit: float
    expected: float
    value: float
    history: list[Iteration]
    cpu_s: float
    converged: bool


@dataclass(frozen=True, eq=False, repr=False)
class FinalState(BriefText):
    """The final state of an inversion.

    Parameters
    ----------
    problem : ElastographyProblem
        The inverse problem.
    reduced : Reduced
        Its objective.
    x : numpy.ndarray
        (unknowns,) the solution.
    """

    problem: ElastographyProblem
    reduced: Reduced
    x: Array


@dataclass(repr=False, eq=False)
class Inversion(Result):
    """The result of `invert`.

    Parameters
    ----------
    data : WaveData
        The data.
    maps : dict of str to numpy.ndarray
        Property → (n,) at the points of the data, NaN where a point is left out.
    predicted : numpy.ndarray
        (loads, n, dim) waves of these maps, m.
    starts : list of StartResult
        The starts: "waves", "uniform", "both"; of large grids the same of coarser elements, as "coarse waves", and "fine".
    chosen : str
        Name of the start whose maps these are.
    noise : RelativeNoise
        Relative noise that the weights of the data stand for.
    noise_found : float
        The same from the misfit (rms).
    regulariser : str
        Its name.
    weights : dict of str to float
        Field → regularisation weight.
    determined : dict of str to float
        Field → number of parameters that the data determine.
    resolution : dict of str to float
        Field → estimate of the finest detail, m (see `quality.map_resolution`).
    solves : Solves
        Counts of linear solves.
    model : dict
        Numbers of elements and unknowns, and facts about the model.
    checks : dict of str to float or bool
        Such as the median strain SNR, the distance of a resonance, and misfit over its expected value.
    strain : OctahedralShearStrain
        Of the data, with its SNR.
    stated : float
        Noise relative to the rms, as given, or the residual of a smooth fit.
    final_state : FinalState, optional
        For error bars (`uncertainty`); None for zones and slices.
    """

    data: WaveData
    maps: dict[str, Array]
    predicted: Array
    starts: list[StartResult]
    chosen: str
    noise: RelativeNoise
    noise_found: float
    regulariser: str
    weights: dict[str, float]
    determined: dict[str, float]
    resolution: dict[str, float]
    solves: Solves
    model: dict[str, Any]
    checks: dict[str, float | bool]
    strain: OctahedralShearStrain
    stated: float = np.nan
    final_state: FinalState | None = field(default=None, repr=False)

    @property
    def chosen_start(self) -> StartResult:
        """The chosen start."""
        return next(start for start in self.starts if start.name == self.chosen)

    @property
    def answers(self) -> dict[str, dict[str, float]]:
        """Statistics of the maps, as in `result.json`."""
        return map_statistics(self.data, self.maps)

    @property
    def reasons(self) -> list[str]:
        """Reasons against the use of the maps."""
        return reasons_against(
            self.data,
            self.maps,
            self.stated,
            self.noise_found,
            self.strain.volume,
            self.strain.discontinuity_share,
            float(self.checks.get(PATCHES, 0.0)),
        )

    @property
    def value(self) -> dict[str, Array]:
        """The maps."""
        return self.maps

    def plot(self) -> Any:
        """The maps."""
        return drawn(self.data.points, self.maps, MODULI)

    @property
    def headline(self) -> str:
        """Medians of the maps."""
        return ", ".join(f"{name} {of['median']:.4g}" for name, of in self.answers.items())

    @property
    def statistics(self) -> dict[str, float]:
        """Numbers of iterations and linear solves of all starts."""
        return {"iterations": len(self.history), **{name: n for name, n in asdict(self.solves).items() if n}}

    @property
    def by_label(self) -> dict[str, dict[int, dict[str, float]]]:
        """Map or derived map → label → median and IQR; empty without labels."""
        labels = self.data.labels
        if labels is None:
            return {}
        return {
            name: statistics_by_label(values, labels) for name, values in {**self.maps, **self.derived_maps}.items()
        }

    @property
    def derived_maps(self) -> dict[str, Array]:
        """Maps (n,) derived from G* (from μ where there are fibres), and `fibre_shear_moduli`."""
        return compute_derived_maps(self.data, self.maps)

    def arrays(self) -> dict[str, Array]:
        """Return values at the points of the data, by name, in SI units: the maps, derived maps and waves.

        points, measured, predicted, and residual: measured minus predicted over the noise of real and of imaginary parts.
        `magnitude, phase, damping_ratio, stiffness` are those of `maps_from_shear`. With fibres they stand for μ alone, and
        `shear_along`, `shear_stretch` (Pa) are what waves determine best (`fibre_shear_moduli`). `oss` and `oss_snr` (loads,
        n) are the octahedral shear strain of the data and its SNR, NaN where a component is not measured.
        """
        measured = np.where(self.data.mask[:, None], self.data.displacement, np.nan)
        residual = (measured - self.predicted) / noise_deviation(self.data, self.noise)
        waves = {"measured": measured, "predicted": self.predicted, "residual": residual}
        strain = {"oss": self.strain.oss, "oss_snr": self.strain.snr}
        return {"points": self.data.points, **self.maps, **self.derived_maps, **waves, **strain}

    def to_xarray(self) -> Any:
        """As `xarray.Dataset`: maps, derived maps, waves and strains, on a grid along x, y, z; raises `MissingExtra`."""
        found = self.arrays()
        waves = (("load", "point", "component"), "complex amplitude of the displacement")
        described = {
            "measured": (waves[0], found["measured"], "m", f"measured {waves[1]}"),
            "predicted": (waves[0], found["predicted"], "m", f"predicted {waves[1]}"),
            "residual": (waves[0], found["residual"], "1", "measured minus predicted over the noise"),
            "oss": (("load", "point"), found["oss"], "1", "octahedral shear strain"),
            "oss_snr": (
                ("load", "point"),
                found["oss_snr"],
                "1",
                "signal-to-noise ratio of the octahedral shear strain",
            ),
        }
        made = wave_dataset(self.data, map_variables({**self.maps, **self.derived_maps}) | described)
        return made.assign_attrs(status=str(self.status), usable=str(self.usable))

    def _range(self) -> dict[str, list[float]]:
        if not np.ndim(self.noise):
            return {}
        known = np.asarray(self.noise)[self.data.mask]
        return {"range": [float(known.min()), float(known.max())]}

    def to_dict(self) -> dict[str, Any]:
        """Return all numbers, for JSON."""
        starts = {
            start.name: {
                "misfit": start.misfit,
                "expected_misfit": start.expected,
                "objective": start.value,
                "iterations": len(start.history),
                "cpu_s": start.cpu_s,
                "converged": start.converged,
                "answers": map_statistics(self.data, start.maps),
                "misfit_over_expected": [each.misfit / each.expected for each in start.history],
                "weights": [each.weights for each in start.history],
            }
            for start in self.starts
        }
        fields = property_fields(self.maps, self.data.labels)
        return {
            "status": str(self.status),
            "usable": self.usable,
            "reasons": self.reasons,
            "answers": self.answers,
            "by_label": self.by_label,
            "solves": asdict(self.solves),
            "checks": self.checks,
            "model": {
                **self.model,
                "regulariser": self.regulariser,
                "weights": self.weights,
                "fields": {name: asdict(fields[name]) for name in self.weights if name in fields},
                "effective_dof": self.determined,
                "resolution_mm": {name: 1e3 * length for name, length in self.resolution.items()},
            },
            "noise": {
                "stated": self.stated,
                "assumed": rms_noise(self.data, self.noise),
                "estimated": self.noise_found,
                **self._range(),
            },
            "starts": starts,
            "selected_start": self.chosen,
            "warnings": self.warnings,
        }


def compute_derived_maps(data: WaveData, maps: Mapping[str, Array]) -> dict[str, Array]:
    """Return maps derived from those of an inversion, see `Inversion.derived_maps`.

    Parameters
    ----------
    data : WaveData
        The data.
    maps : mapping of str to numpy.ndarray
        Property → (n,)

    Returns
    -------
    dict of str to numpy.ndarray
        Name → (n,)
    """
    modulus = maps_from_shear(shear_modulus_map(data, maps))
    return {**fibre_shear_moduli(maps), **{name: modulus[name] for name in DERIVED}}
