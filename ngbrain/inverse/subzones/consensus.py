"""A zone inverted once more, knowing what all zones found together.

It starts from the joined maps and waves and keeps weights that all zones share. Where its neighbours know better than it does
itself, towards its cut faces, two things come from them. Where their share is larger than its own, data are the joined waves ū,
which have less noise than the measured ones: so cut faces are driven by what the neighbours know of the waves. And logarithms m
of moduli are drawn to those of the joined map m̄:

    J(m, g) = ½ Σ_p |u_p - d_p|²/σ_p² + ½ α R(m) + ½ Σ_p κ (1 - s_p) (m_p - m̄_p)²

over points p; g displacements of the boundary, s_p the zone's share, (d, σ) measured or (ū, τ), τ from how far zones' waves
are apart, κ from how far their moduli are and how many numbers of them the data determine.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from ngbrain.adjoint.reduced import Reduced, Regulariser
from ngbrain.forward.common.solve_counts import Solves
from ngbrain.inverse.data.quality import noise_deviation, rms_noise
from ngbrain.inverse.data.subset import WaveSubset
from ngbrain.inverse.elastography.result import Inversion, build_inversion, start_result
from ngbrain.inverse.objective.misfit import LeastSquares
from ngbrain.inverse.objective.regularisers import Prior
from ngbrain.inverse.optimise.gauss_newton_cg import GaussNewtonCG
from ngbrain.inverse.optimise.regularisation_weight import EffectiveParameterCounter, MisfitLevel, WeightPolicy
from ngbrain.inverse.optimise.result import Iteration
from ngbrain.inverse.problem.discretisation import Discretisation
from ngbrain.inverse.problem.field_values import field_observations, fit_field
from ngbrain.inverse.problem.property_fields import build_composition
from ngbrain.inverse.problem.wave_problem import ElastographyProblem

Array = np.ndarray
SURE = 0.1
"""Standard deviation of joined waves at least, over that of measured ones."""


@dataclass(frozen=True, eq=False)
class Neighbourhood:
    """What a zone is told.

    logarithms  quantity → m̄ (n,) at the points of the zone's data, NaN where there is none
    waves       (loads, n, dim) m, joined ū
    deviation   (loads, 1, dim) m, τ, of real and of imaginary parts
    foreign     (n,) 1 - s, what others share of the joined map
    weights     field → α
    strength    quantity → κ
    """

    logarithms: Mapping[str, Array]
    waves: Array
    deviation: Array
    foreign: Array
    weights: Mapping[str, float]
    strength: Mapping[str, float]

    @property
    def digest(self) -> str:
        """Tells it from others."""
        arrays = [*self.logarithms.values(), self.waves, self.deviation, self.foreign]
        digest = hashlib.sha256(b"".join(np.ascontiguousarray(each).tobytes() for each in arrays)).hexdigest()
        return f"{digest} {dict(self.weights)} {dict(self.strength)}"


class ConsensusRegulariser:
    """A regulariser, and ½ Σ w_p (x(p) - v_p)² / α at points p.

    inner   the regulariser, of weight α
    at      (n, unknowns), values at the points
    values, pull   v (n,) and w/α (n,)
    """

    def __init__(self, inner: Regulariser, at: sp.csr_array, values: Array, pull: Array) -> None:
        self.inner, self.at, self.values, self.pull = inner, at, values, pull
        self._matrix = sp.csr_array(at.T @ sp.diags_array(pull) @ at)

    def matrix(self, block: Array) -> sp.csr_array:
        """Of both."""
        return sp.csr_array(self.inner.matrix(block) + self._matrix)

    def value(self, block: Array) -> float:
        """The energy of both."""
        return self.inner.value(block) + 0.5 * float(np.sum(self.pull * (self.at @ block - self.values) ** 2))

    def gradient(self, block: Array) -> Array:
        """Its gradient."""
        return self.inner.gradient(block) + self.at.T @ (self.pull * (self.at @ block - self.values))

    def hvp(self, block: Array, direction: Array) -> Array:
        """The second derivative of both times a direction."""
        return self.inner.hvp(block, direction) + self._matrix @ direction


@dataclass
class SharedWeights(WeightPolicy):
    """Weights as they are, for all zones the same."""

    def update(
        self,
        reduced: Reduced,
        x: Array,
        level: MisfitLevel,
        factor: EffectiveParameterCounter,
        random: np.random.Generator,
    ) -> float:
        """1; what the data determine is counted."""
        blocks = reduced.unknowns.blocks
        regular = {name: reduced.weights[name] * r.matrix(x[blocks[name]]) for name, r in reduced.regularisers.items()}
        self.determined = factor.effective_parameters_by_block(blocks, regular, random)
        return 1.0


def invert_with_consensus(
    data: WaveSubset,
    elements: Discretisation,
    around: Neighbourhood,
    prior: Prior,
    *,
    floor: float,
    labelled: bool,
    rounds: int,
    solves: Solves,
    checkpoint: str | os.PathLike[str] | None = None,
    callback: Callable[[Iteration], None] = lambda _: None,
) -> Inversion:
    """A zone's maps next to its neighbours', its noise as its data say; arguments are those of `invert_in_space`, and where solves
    are counted.
    """
    assert data.noise is not None  # `invert_by_subzones` has seen to it
    composition = build_composition(data, elements, labelled)
    # Its boundary starts from the joined waves, which have less noise than the measured ones.
    problem = ElastographyProblem(replace(data, displacement=around.waves), elements, composition=composition)
    problem.model.solves = solves
    sigma = noise_deviation(data, data.noise)
    unknowns = problem.unknowns(sigma)
    others = (around.foreign > 0.5)[:, None]
    measured = np.where(others, around.waves, data.displacement)
    deviation = np.where(others, np.clip(around.deviation, SURE * sigma, sigma), sigma)
    misfit = LeastSquares(measured[:, problem.inside], deviation[:, problem.inside])
    x, regularisers = unknowns.start.copy(), dict[str, Regulariser]()
    for field, own, at, values in field_observations(problem, around.logarithms):
        name = field.name
        block, weight, strength = unknowns.blocks[name], around.weights[name], around.strength[field.quantity]
        inner = prior(problem.space, unknowns.start[block])
        x[block] = fit_field(at, values, inner, x[block])
        regularisers[name] = ConsensusRegulariser(inner, at, values, strength * around.foreign[own] / weight)
    weights = {name: around.weights[name] for name in regularisers}
    reduced = Reduced(problem.model, misfit, unknowns, regularisers, weights)
    way = GaussNewtonCG(reduced, SharedWeights(), checkpoint=checkpoint, callback=callback)
    found = way.resume(rounds) if way.has_checkpoint else way.descend(x, rounds)
    rows = [start_result("zones", problem, reduced, found)]
    return build_inversion(
        problem,
        reduced,
        found,
        rows,
        "zones",
        noise=data.noise,
        stated=rms_noise(data, data.noise),
        floor=floor,
        regulariser="smooth",
        weight="evidence",
        history=found.history,
        notes=[],
    )
