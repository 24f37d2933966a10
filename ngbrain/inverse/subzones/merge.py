"""Joined maps and waves, shared regularisation weights, disagreement of zones, and the final `Inversion`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ngbrain.forward.common.solve_counts import Solves
from ngbrain.inverse.data.plausibility import amplitude_notes, tissue_notes, wavelength_notes
from ngbrain.inverse.data.quality import (
    RelativeNoise,
    map_resolution,
    noise_deviation,
    noise_for_misfit,
    octahedral_shear_strain,
    rms_noise,
)
from ngbrain.inverse.elastography.assembly import misfit_notes
from ngbrain.inverse.elastography.derived_maps import median_shear
from ngbrain.inverse.elastography.identifiability import (
    bulk_modulus_note,
    fibre_notes,
    poorly_determined_notes,
    scale_notes,
)
from ngbrain.inverse.elastography.result import Inversion, StartResult
from ngbrain.inverse.objective.misfit import LeastSquares
from ngbrain.inverse.optimise.regularisation_weight import MisfitLevel
from ngbrain.inverse.optimise.result import convergence_status
from ngbrain.inverse.problem.boundary_data import free_boundary, mark_driven_boundary
from ngbrain.inverse.problem.properties import material_properties
from ngbrain.inverse.problem.property_fields import PropertyField, property_fields
from ngbrain.inverse.problem.voxel_lattice import VoxelLattice
from ngbrain.inverse.subzones.global_check import global_misfit
from ngbrain.inverse.subzones.partition import Zone, disagreement, merge_values
from ngbrain.inverse.subzones.roughness import Roughness
from ngbrain.inverse.subzones.zone_result import ZoneResult
from ngbrain.io.waves import WaveData

Array = np.ndarray
APART = 0.1
"""Disagreement of two zones from which a note mentions it."""
CLOSEST = 0.01
"""Least disagreement in the strength of the prior: neighbours are not taken to be more accurate."""


@dataclass(frozen=True, eq=False)
class MergedZones:
    """Zones with their results.

    Parameters
    ----------
    data : WaveData
        All data.
    zones : sequence of Zone
        The zones.
    roughness : sequence of Roughness
        The roughness of maps in each zone.
    results : sequence of ZoneResult
        The result of each zone.
    independent : MergedZones, optional
        The same before any consensus pass.
    """

    data: WaveData
    zones: Sequence[Zone]
    roughness: Sequence[Roughness]
    results: Sequence[ZoneResult]
    independent: MergedZones | None = None

    @cached_property
    def logarithms(self) -> dict[str, Array]:
        """Property → joined ln(value - lower bound) (n,), NaN where no zone has one."""
        return {
            name: merge_values(self.zones, each, len(self.data.points)) for name, each in self._own_logarithms.items()
        }

    @cached_property
    def maps(self) -> dict[str, Array]:
        """Property → joined map (n,)."""
        return {name: self._floors[name] + np.exp(values) for name, values in self.logarithms.items()}

    @cached_property
    def waves(self) -> Array:
        """Joined predicted waves (loads, n, dim) m."""
        n, parts = len(self.data.points), []
        for i in range(self.data.dim):
            parts.append(merge_values(self.zones, [result.predicted[:, :, i] for result in self.results], n))
        return np.stack(parts, axis=-1)

    @cached_property
    def deviation(self) -> Array:
        """Standard deviation (loads, 1, dim) m of a zone's waves, of real and of imaginary parts.

        It is half the rms of u_a - u_b in overlaps.
        """
        n, loads, dim = len(self.data.points), self.data.loads, self.data.dim
        apart = [
            [disagreement(self.zones, [result.predicted[k, :, i] for result in self.results], n) for i in range(dim)]
            for k in range(loads)
        ]
        return np.array(apart)[:, None] / 2

    @cached_property
    def disagreement(self) -> dict[str, float]:
        """Property → rms difference of two zones' logarithms where they overlap."""
        n = len(self.data.points)
        return {name: disagreement(self.zones, values, n) for name, values in self._own_logarithms.items()}

    @cached_property
    def weights(self) -> dict[str, float]:
        """Field → the weight that maximises the evidence of all zones, α = Σ s_z α_z E_z / E.

        s_z is the mean of a zone's share, E_z the roughness of its map, and E that of the joined map. A zone's own weight α_z
        makes α_z E_z equal to the number of parameters that its data determine (up to a factor). So a rough place in several
        zones counts once.
        """
        found = {}
        for name, wanted in self.roughness_energy.items():
            parts = zip(self.zones, self.roughness, strict=True)
            joint = self.logarithms[self._fields[name].quantity]
            found[name] = wanted / sum(
                rough.compute(self._where(name, zone, joint[zone.points]), zone.share) for zone, rough in parts
            )
        return found

    @cached_property
    def roughness_energy(self) -> dict[str, float]:
        """Field → Σ s_z α_z E_z of independent zones."""
        if self.independent:
            return self.independent.roughness_energy
        found: dict[str, float] = {}
        for zone, rough, result in zip(self.zones, self.roughness, self.results, strict=True):
            for name, weight in result.weights.items():
                own = self._logarithm(result, self._fields[name].quantity)
                part = float(np.mean(zone.share)) * weight * rough.compute(self._where(name, zone, own))
                found[name] = found.get(name, 0.0) + part
        return found

    def _where(self, name: str, zone: Zone, values: Array) -> Array:
        """A zone's values of a property where a field of it is defined; NaN elsewhere."""
        labels = None if self.data.labels is None else self.data.labels[zone.points]
        return np.where(self._fields[name].mask(labels), values, np.nan)

    @cached_property
    def determined(self) -> dict[str, float]:
        """Field → number of parameters that the data determine, the zones' numbers weighted by their mean shares."""
        found: dict[str, float] = {}
        for zone, result in zip(self.zones, self.results, strict=True):
            for name, number in result.determined.items():
                found[name] = found.get(name, 0.0) + float(np.mean(zone.share)) * number
        return found

    @property
    def strength(self) -> dict[str, float]:
        """Property → κ: determined parameters for each point, over half the square of the disagreement."""
        found = {}
        for quantity, off in self.disagreement.items():
            numbers = sum(number for name, number in self.determined.items() if self._fields[name].quantity == quantity)
            known = int(np.isfinite(self.logarithms[quantity]).sum())
            found[quantity] = float(2 * numbers / known / max(off, CLOSEST) ** 2)
        return found

    def start_result(self, name: str, noise: RelativeNoise) -> StartResult:
        """Return the joined result, with the misfit of the joined waves and its expected value.

        Parameters
        ----------
        name : str
            Name of the pass.
        noise : RelativeNoise
            As `noise_deviation` takes it.

        Returns
        -------
        StartResult
            The result.
        """
        measured = np.where(np.isnan(self.waves), np.nan, self.data.displacement)
        misfit = LeastSquares(measured, noise_deviation(self.data, noise))
        expected = sum(result.expected for result in self.results) / sum(result.count for result in self.results)
        return StartResult(
            name=name,
            maps=self.maps,
            misfit=2 * misfit.value(np.nan_to_num(self.waves)),
            expected=misfit.count * expected,
            value=sum(result.value for result in self.results),
            history=[each for result in self.results for each in result.history],
            cpu_s=sum(result.history[-1].cpu_s for result in self.results),
            converged=all(result.converged for result in self.results),
        )

    def rms_check(self, name: str) -> float | None:
        """Return the rms of a check over zones, weighted by their shares; None where no zone has it."""
        pairs = [
            (float(np.sum(z.share)), a.checks[name])
            for z, a in zip(self.zones, self.results, strict=True)
            if name in a.checks
        ]
        if not pairs:
            return None
        weights, values = np.array(pairs).T
        return float(np.sqrt(np.sum(weights * values**2) / weights.sum()))

    @cached_property
    def _own_logarithms(self) -> dict[str, list[Array]]:
        return {name: [self._logarithm(result, name) for result in self.results] for name in self._floors}

    def _logarithm(self, result: ZoneResult, quantity: str) -> Array:
        return np.log(result.maps[quantity] - self._floors[quantity])

    @cached_property
    def _fields(self) -> dict[str, PropertyField]:
        return property_fields(self._floors, self.data.labels)

    @cached_property
    def _floors(self) -> dict[str, float]:
        return {quantity.name: quantity.lower for quantity in material_properties(self.data, 1.0)}


def merge_inversion(
    found: Sequence[MergedZones],
    cells: VoxelLattice,
    *,
    noise: RelativeNoise,
    floor: float,
    labelled: bool,
    notes: list[str],
) -> Inversion:
    """Build the `Inversion` of zones after the last pass.

    Parameters
    ----------
    found : sequence of MergedZones
        The passes; those before the last are listed in `starts`.
    cells : VoxelLattice
        The body's lattice.
    noise : RelativeNoise
        Noise that the weights of the data stand for.
    floor : float
        Least relative noise: with less, the data are fitted as closely as the elements allow.
    labelled : bool
        Whether each label has fields of its own.
    notes : list of str
        Warnings so far.

    Returns
    -------
    Inversion
        Joined maps, checks and warnings.
    """
    first, last = found[0], found[-1]
    data, results, zones = last.data, last.results, last.zones
    names = ["zones", *(f"pass {i}" for i in range(1, len(found)))]
    starts = [each.start_result(name, noise) for name, each in zip(names, found, strict=True)]
    level = MisfitLevel(starts[-1].misfit, starts[-1].expected)
    solves, effect, strain = (
        _solves(found),
        last.rms_check("bulk_change_over_noise"),
        octahedral_shear_strain(data, noise),
    )
    body = global_misfit(data, cells, last.logarithms, last.waves, noise, labelled, solves)
    of_plane, combined = fibre_notes(data, last.maps)
    notes = [*notes, *_zone_notes(found, level), *misfit_notes(level.ratio, rms_noise(data, noise), floor)]
    notes += [
        *poorly_determined_notes(last.determined),
        *of_plane,
        *scale_notes(data),
        *([] if effect is None else [bulk_modulus_note(effect)]),
    ]
    median = median_shear(data, last.maps)
    notes += [*wavelength_notes(data, median), *tissue_notes(data, median), *amplitude_notes(data)]
    checks: dict[str, float | None] = {
        "misfit_over_expected": level.ratio,
        "converged": starts[-1].converged,
        "strain_snr": strain.median,
        "misfit_as_one_body": None if body is None else body.ratio,
        "bulk_change_over_noise": effect,
        **{f"disagreement_{name}_first": off for name, off in first.disagreement.items()},
        **{f"disagreement_{name}": off for name, off in last.disagreement.items()},
    }
    free = free_boundary(mark_driven_boundary(data, cells.mesh)[0])
    volume = data.point_spacing**data.dim if data.grid is None else float(np.prod(data.grid.spacing))
    known = int(np.isfinite(np.sum(list(last.maps.values()), axis=0)).sum())
    sizes = [len(zone.points) for zone in zones]
    return Inversion(
        data=data,
        maps=last.maps,
        predicted=last.waves,
        starts=starts,
        chosen=names[-1],
        noise=noise,
        noise_found=rms_noise(data, noise_for_misfit(data, noise, level.ratio)),
        regulariser="smooth",
        weights=last.weights,
        determined=last.determined,
        resolution=map_resolution(volume * known, data.dim, last.determined),
        solves=solves,
        history=[each for row in starts for each in row.history],
        model={
            "form": results[0].form,
            "n_elements": sum(result.numbers["n_elements"] for result in results),
            "n_unknowns": max(result.numbers["n_unknowns"] for result in results),
            "n_parameters": sum(result.numbers["n_parameters"] for result in results),
            "inverse_crime": False,
            "weight": "evidence",
            "zones": len(zones),
            "points_of_a_zone": [min(sizes), max(sizes)],
            **({"free_boundary": free} if free else {}),
            **({"errors_of_moduli": combined} if combined else {}),
        },
        checks={name: value for name, value in checks.items() if value is not None},
        strain=strain,
        stated=rms_noise(data, noise),
        warnings=notes + ([strain.note] if strain.note else []),
        status=convergence_status(starts[-1].converged),
    )


def _zone_notes(found: Sequence[MergedZones], level: MisfitLevel) -> list[str]:
    last, notes = found[-1], []
    far = {name: off for name, off in last.disagreement.items() if off > APART}
    if far:
        words = ", ".join(f"{name} by {100 * off:.2g} %" for name, off in far.items())
        notes.append(f"zones differ where they overlap, {words} (rms): larger zones, or more data, would reduce this")
    lost = last.data.mask & np.isnan(next(iter(last.maps.values())))
    if lost.any():
        of_all = f"{int(lost.sum())} of {int(last.data.mask.sum())} points"
        notes.append(f"{of_all} have no map: they are in no element, at the border, or in pieces too small for a zone")
    going = sum(not result.converged for result in last.results)
    if going:
        notes.append(
            f"{going} of {len(last.results)} zones stopped before fields and weights converged: the total misfit is "
            f"{level.misfit:.4g}, its expected value {level.expected:.4g}"
        )
    return notes


def _solves(found: Sequence[MergedZones]) -> Solves:
    return Solves.sum(result.solves for each in found for result in each.results)
