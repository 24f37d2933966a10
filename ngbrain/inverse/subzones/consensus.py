"""The inversion of a zone with prior information from its neighbours.

It starts from the joined maps and waves, with regularisation weights that all zones share. Towards its cut faces a zone's
neighbours are more accurate than the zone itself. Where their share is larger than its own, two things come from them:

- The data are the joined waves ū, which have less noise than the measured ones. So the joined waves drive the cut faces.
- A penalty draws the logarithms m of moduli to those of the joined map m̄.

    J(m, g) = ½ Σ_p |u_p - d_p|²/σ_p² + ½ α R(m) + ½ Σ_p κ (1 - s_p) (m_p - m̄_p)²

over points p. g are displacements of the boundary, s_p is the zone's share, (d, σ) are the measured data or (ū, τ). τ follows
from the difference of the zones' waves. κ follows from the difference of their moduli and the number of parameters that the
data determine.
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
from ngbrain.inverse.elastography.assembly import build_inversion, start_result
from ngbrain.inverse.elastography.result import Inversion
from ngbrain.inverse.objective.misfit import LeastSquares
from ngbrain.inverse.objective.regularisers import Prior
from ngbrain.inverse.optimise.gauss_newton_cg import GaussNewtonCG
from ngbrain.inverse.optimise.regularisation_weight import EffectiveParameterCounter, MisfitLevel, WeightPolicy
from ngbrain.inverse.optimise.result import Iteration
from ngbrain.inverse.problem.discretisation import Discretisation
from ngbrain.inverse.problem.field_values import field_observations, fit_field
from ngbrain.inverse.problem.property_fields import build_composition
from ngbrain.inverse.problem.wave_problem import ElastographyProblem
from ngbrain.look import BriefText

Array = np.ndarray
SURE = 0.1
"""Least standard deviation of joined waves, relative to that of measured ones."""


@dataclass(frozen=True, eq=False, repr=False)
class Neighbourhood(BriefText):
    """Prior information for a zone.

    Parameters
    ----------
    logarithms : mapping of str to numpy.ndarray
        Property → m̄ (n,) at the points of the zone's data, NaN where there is none.
    waves : numpy.ndarray
        (loads, n, dim) joined waves ū, m.
    deviation : numpy.ndarray
        (loads, 1, dim) τ of real and of imaginary parts, m.
    foreign : numpy.ndarray
        (n,) 1 - s, the other zones' share of the joined map.
    weights : mapping of str to float
        Field → regularisation weight α.
    strength : mapping of str to float
        Property → κ.
    """

    logarithms: Mapping[str, Array]
    waves: Array
    deviation: Array
    foreign: Array
    weights: Mapping[str, float]
    strength: Mapping[str, float]

    @property
    def digest(self) -> str:
        """Digest of the contents, which identifies them in checkpoints."""
        arrays = [*self.logarithms.values(), self.waves, self.deviation, self.foreign]
        digest = hashlib.sha256(b"".join(np.ascontiguousarray(each).tobytes() for each in arrays)).hexdigest()
        return f"{digest} {dict(self.weights)} {dict(self.strength)}"


class ConsensusRegulariser:
    """A regulariser plus ½ Σ w_p (x(p) - v_p)² / α at points p.

    Parameters
    ----------
    inner : Regulariser
        The regulariser, of weight α.
    at : scipy.sparse.csr_array
        (n, unknowns) interpolation matrix to the points.
    values : numpy.ndarray
        (n,) v.
    pull : numpy.ndarray
        (n,) w/α.
    """

    def __init__(self, inner: Regulariser, at: sp.csr_array, values: Array, pull: Array) -> None:
        self.inner, self.at, self.values, self.pull = inner, at, values, pull
        self._matrix = sp.csr_array(at.T @ sp.diags_array(pull) @ at)

    def matrix(self, block: Array) -> sp.csr_array:
        """Return the Hessian of both terms."""
        return sp.csr_array(self.inner.matrix(block) + self._matrix)

    def value(self, block: Array) -> float:
        """Return the energy of both terms."""
        return self.inner.value(block) + 0.5 * float(np.sum(self.pull * (self.at @ block - self.values) ** 2))

    def gradient(self, block: Array) -> Array:
        """Return the gradient of both terms."""
        return self.inner.gradient(block) + self.at.T @ (self.pull * (self.at @ block - self.values))

    def hvp(self, block: Array, direction: Array) -> Array:
        """Return the Hessian-vector product of both terms.

        Parameters
        ----------
        block : numpy.ndarray
            (unknowns,) where.
        direction : numpy.ndarray
            (unknowns,) the vector.

        Returns
        -------
        numpy.ndarray
            (unknowns,)
        """
        return self.inner.hvp(block, direction) + self._matrix @ direction


@dataclass
class SharedWeights(WeightPolicy):
    """Fixed weights, the same for all zones."""

    def update(
        self,
        reduced: Reduced,
        x: Array,
        level: MisfitLevel,
        counter: EffectiveParameterCounter,
        random: np.random.Generator,
    ) -> float:
        """Count the parameters that the data determine; the weights stay as they are.

        Parameters
        ----------
        reduced : Reduced
            The zone's objective.
        x : numpy.ndarray
            (unknowns,) where.
        level : MisfitLevel
            Misfit and its expected value.
        counter : EffectiveParameterCounter
            The factorised Hessian.
        random : numpy.random.Generator
            For stochastic traces.

        Returns
        -------
        float
            1, the factor on the weights.
        """
        blocks = reduced.unknowns.blocks
        regular = {name: reduced.weights[name] * r.matrix(x[blocks[name]]) for name, r in reduced.regularisers.items()}
        self.determined = counter.effective_parameters_by_block(blocks, regular, random)
        return 1.0


def invert_with_consensus(
    data: WaveSubset,
    elements: Discretisation,
    around: Neighbourhood,
    prior: Prior,
    *,
    floor: float,
    labelled: bool,
    max_iterations: int,
    solves: Solves,
    checkpoint: str | os.PathLike[str] | None = None,
    callback: Callable[[Iteration], None] = lambda _: None,
) -> Inversion:
    """Invert a zone with prior information from its neighbours. The noise is that of its data.

    Parameters
    ----------
    data : WaveSubset
        The zone's data.
    elements : Discretisation
        Its elements.
    around : Neighbourhood
        Joined maps and waves.
    prior : Prior
        Builds the regulariser of a field.
    floor : float
        Least relative noise; below it the misfit is dominated by discretisation errors.
    labelled : bool
        Whether each label has fields of its own.
    max_iterations : int
        Most iterations.
    solves : Solves
        Counts the linear solves.
    checkpoint : path, optional
        File that is written after each iteration. If it exists, the inversion goes on from it.
    callback : callable
        Is called with each `Iteration`.

    Returns
    -------
    Inversion
        The zone's maps.
    """
    assert data.noise is not None  # `invert_by_subzones` sets it
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
    found = way.resume(max_iterations) if way.has_checkpoint else way.descend(x, max_iterations)
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
