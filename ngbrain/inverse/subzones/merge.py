"""What zones answer together: joined maps and waves, the weights that they share, how far they disagree, and the `Inversion`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
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
from ngbrain.inverse.elastography.derived_maps import median_shear
from ngbrain.inverse.elastography.identifiability import (
    bulk_modulus_note,
    fibre_notes,
    poorly_determined_notes,
    scale_notes,
)
from ngbrain.inverse.elastography.result import Inversion, StartResult, misfit_notes
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
"""Disagreement of two zones from which a note says so."""
CLOSEST = 0.01
"""Disagreement that counts at least: neighbours are not believed more closely."""


@dataclass(frozen=True, eq=False)
class MergedZones:
    """Zones of `data`, how rough maps in each are, and a `ZoneResult` of each; with `alone`, those of independent zones."""

    data: WaveData
    zones: Sequence[Zone]
    roughness: Sequence[Roughness]
    results: Sequence[ZoneResult]
    independent: MergedZones | None = None

    @cached_property
    def logarithms(self) -> dict[str, Array]:
        """Quantity → ln(value - floor) (n,), joined; NaN where no zone has one."""
        return {name: merge_values(self.zones, each, len(self.data.points)) for name, each in self._own.items()}

    @cached_property
    def maps(self) -> dict[str, Array]:
        """Quantity → (n,)."""
        return {name: self._floors[name] + np.exp(values) for name, values in self.logarithms.items()}

    @cached_property
    def waves(self) -> Array:
        """Predicted by all zones (loads, n, dim) m."""
        n, parts = len(self.data.points), []
        for i in range(self.data.dim):
            parts.append(merge_values(self.zones, [answer.predicted[:, :, i] for answer in self.results], n))
        return np.stack(parts, axis=-1)

    @cached_property
    def deviation(self) -> Array:
        """Of a zone's waves, as overlaps show it (loads, 1, dim) m, real and imaginary parts each: half the rms of u_a - u_b."""
        n, loads, dim = len(self.data.points), self.data.loads, self.data.dim
        apart = [
            [disagreement(self.zones, [answer.predicted[k, :, i] for answer in self.results], n) for i in range(dim)]
            for k in range(loads)
        ]
        return np.array(apart)[:, None] / 2

    @cached_property
    def disagreement(self) -> dict[str, float]:
        """Quantity → rms difference of two zones' ln where they overlap."""
        n = len(self.data.points)
        return {name: disagreement(self.zones, values, n) for name, values in self._own.items()}

    @cached_property
    def weights(self) -> dict[str, float]:
        """Field → the weight that the evidence of all zones wants: α = Σ s_z α_z E_z / E, s_z the mean of a zone's share.

        A zone's own weight α_z makes α_z E_z what the numbers that its data determine want, E_z the roughness of its map; E is
        that of the joined one. So a rough place that several zones see counts once.
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
        """Field → Σ s_z α_z E_z, by zones that know nothing of each other."""
        if self.independent:
            return self.independent.roughness_energy
        found: dict[str, float] = {}
        for zone, rough, answer in zip(self.zones, self.roughness, self.results, strict=True):
            for name, weight in answer.weights.items():
                own = self._logarithm(answer, self._fields[name].quantity)
                part = float(np.mean(zone.share)) * weight * rough.compute(self._where(name, zone, own))
                found[name] = found.get(name, 0.0) + part
        return found

    def _where(self, name: str, zone: Zone, values: Array) -> Array:
        """A zone's values of a quantity where a field of it is; NaN elsewhere."""
        labels = None if self.data.labels is None else self.data.labels[zone.points]
        return np.where(self._fields[name].mask(labels), values, np.nan)

    @cached_property
    def determined(self) -> dict[str, float]:
        """Field → how many numbers the data determine, each zone's by its share of the joined map."""
        found: dict[str, float] = {}
        for zone, answer in zip(self.zones, self.results, strict=True):
            for name, number in answer.determined.items():
                found[name] = found.get(name, 0.0) + float(np.mean(zone.share)) * number
        return found

    @property
    def strength(self) -> dict[str, float]:
        """Quantity → κ: numbers determined for each point, over half the square of the disagreement."""
        found = {}
        for quantity, off in self.disagreement.items():
            numbers = sum(number for name, number in self.determined.items() if self._fields[name].quantity == quantity)
            known = int(np.isfinite(self.logarithms[quantity]).sum())
            found[quantity] = float(2 * numbers / known / max(off, CLOSEST) ** 2)
        return found

    def start_result(self, name: str, noise: RelativeNoise) -> StartResult:
        """Misfit of the joined waves, and what zones expect of as many data."""
        measured = np.where(np.isnan(self.waves), np.nan, self.data.displacement)
        misfit = LeastSquares(measured, noise_deviation(self.data, noise))
        expected = sum(answer.expected for answer in self.results) / sum(answer.count for answer in self.results)
        return StartResult(
            name=name,
            maps=self.maps,
            misfit=2 * misfit.value(np.nan_to_num(self.waves)),
            expected=misfit.count * expected,
            value=sum(answer.value for answer in self.results),
            history=[each for answer in self.results for each in answer.history],
            cpu_s=sum(answer.history[-1].cpu_s for answer in self.results),
            converged=all(answer.converged for answer in self.results),
        )

    def rms_check(self, name: str) -> float | None:
        """Rms of a check over zones, by their shares; None where no zone has it."""
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
    def _own(self) -> dict[str, list[Array]]:
        return {name: [self._logarithm(answer, name) for answer in self.results] for name in self._floors}

    def _logarithm(self, answer: ZoneResult, quantity: str) -> Array:
        return np.log(answer.maps[quantity] - self._floors[quantity])

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
    """The last of these answers, those before it as rows; data with less noise than `floor` are fitted as well as elements can."""
    first, last = found[0], found[-1]
    data, answers, zones = last.data, last.results, last.zones
    names = ["zones", *(f"pass {i}" for i in range(1, len(found)))]
    rows = [each.start_result(name, noise) for name, each in zip(names, found, strict=True)]
    level = MisfitLevel(rows[-1].misfit, rows[-1].expected)
    solves, effect, strain = (
        _solves(found),
        last.rms_check("bulk_change_over_noise"),
        octahedral_shear_strain(data, noise),
    )
    body = global_misfit(data, cells, last.logarithms, last.waves, noise, labelled, solves)
    of_plane, combined = fibre_notes(data, last.maps)
    notes = [*notes, *_of_zones(found, level), *misfit_notes(level.ratio, rms_noise(data, noise), floor)]
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
        "converged": rows[-1].converged,
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
        starts=rows,
        chosen=names[-1],
        noise=noise,
        noise_found=rms_noise(data, noise_for_misfit(data, noise, level.ratio)),
        regulariser="smooth",
        weights=last.weights,
        determined=last.determined,
        resolution=map_resolution(volume * known, data.dim, last.determined),
        solves=solves,
        history=[each for row in rows for each in row.history],
        model={
            "form": answers[0].form,
            "n_elements": sum(answer.numbers["n_elements"] for answer in answers),
            "n_unknowns": max(answer.numbers["n_unknowns"] for answer in answers),
            "n_parameters": sum(answer.numbers["n_parameters"] for answer in answers),
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
        status=convergence_status(rows[-1].converged),
    )


def _of_zones(found: Sequence[MergedZones], level: MisfitLevel) -> list[str]:
    last, notes = found[-1], []
    far = {name: off for name, off in last.disagreement.items() if off > APART}
    if far:
        words = ", ".join(f"{name} by {100 * off:.2g} %" for name, off in far.items())
        notes.append(f"zones differ where they overlap, {words} (rms): larger zones, or more data, would tell")
    lost = last.data.mask & np.isnan(next(iter(last.maps.values())))
    if lost.any():
        of_all = f"{int(lost.sum())} of {int(last.data.mask.sum())} points"
        notes.append(f"{of_all} have no map: they are in no element, at the border, or in pieces too small for a zone")
    going = sum(not answer.converged for answer in last.results)
    if going:
        notes.append(
            f"{going} of {len(last.results)} zones stopped before fields and weights had settled: the misfit of all is "
            f"{level.misfit:.4g}, expected are {level.expected:.4g}"
        )
    return notes


def _solves(found: Sequence[MergedZones]) -> Solves:
    every = [asdict(answer.solves) for each in found for answer in each.results]
    return Solves(**{name: sum(each[name] for each in every) for name in every[0]})
