"""What a relaxing material answers in a homogeneous test: histories, relaxation, creep, small oscillations."""

from __future__ import annotations

import ngsolve as ngs
import numpy as np
from ngsolve import CoefficientFunction
from numpy.typing import ArrayLike

from ngbrain.errors import InputError
from ngbrain.materials.base import Deformation
from ngbrain.materials.flow import REST, SUDDEN, Flow, Flows
from ngbrain.materials.lab.modes import Mode, find_mode
from ngbrain.materials.lab.specimen import STATIONARY, Specimen, check_homogeneous, describe_law, warn_beyond
from ngbrain.materials.modulus import PronySeries
from ngbrain.materials.points import Points, initial_modulus, number
from ngbrain.materials.viscous import Viscous, step_factors
from ngbrain.tensors import to_voigt

RAMP_STEPS = 200


def history(material: Viscous, mode: str, times: ArrayLike, stretches: ArrayLike) -> np.ndarray:
    """Nominal stress (Pa) over time, of the shape of `stretches`: (times,), or (histories, times) for many at once.

    times      s, increasing from 0 on
    stretches  at these times; what is there at time 0 was put on suddenly (every branch starts with H = S̄)

    Exact where the branches' stresses are linear in time within each step, else second order in the steps.

    >>> from ngbrain.materials import NeoHooke, Prony
    >>> material = Prony(NeoHooke(1000.0), g=[0.5], tau=[2.0])
    >>> history(material, "shear", [0.0, 2.0, 100.0], [0.1, 0.1, 0.1])
    array([100.   ,  68.394,  50.   ])
    """
    test, times = _test(material, mode), _checked_times(times)
    values = _checked_histories(test, times, stretches)
    warn_beyond(material, test, values)
    rows = values.reshape(-1, len(times))
    answer = _symmetric(material, test, times, rows)
    if answer is None:
        answer = _stepped(material, test, times, rows)
    return answer.reshape(values.shape)


def relaxation(material: Viscous, mode: str, stretch: float, times: ArrayLike, rise: float = 0.0) -> np.ndarray:
    """Nominal stress (Pa) at `times` (s, increasing, ≥ 0) of a stretch that is held, after a ramp from rest of `rise` s.

    Without `rise` the stretch is sudden, and the answer is exact at any times.

    >>> from ngbrain.materials import NeoHooke, Prony
    >>> relaxation(Prony(NeoHooke(1000.0), g=[0.5], tau=[2.0]), "shear", 0.1, [2.0, 100.0])
    array([68.394, 50.   ])
    """
    test, wanted = _test(material, mode), _checked_times(times, from_rest=False)
    if not (np.isfinite(rise) and rise >= 0):
        raise InputError("rise", rise, "a time of at least 0 s")
    ramp = np.linspace(0, rise, RAMP_STEPS + 1) if rise else np.zeros(1)
    grid = np.union1d(ramp, wanted)
    share = np.minimum(grid / rise, 1.0) if rise else np.ones_like(grid)
    stretches = test.rest + (float(test.check_stretches(stretch)) - test.rest) * share
    return history(material, mode, grid, stretches)[np.searchsorted(grid, wanted)]


def press(material: Viscous, mode: str, times: ArrayLike, stretches: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Stretch and nominal stress (Pa) of a body that plates press but never pull, of the shape of `stretches`.

    times      s, increasing from 0 on
    stretches  that the plates would hold the body at: (times,), or (histories, times) for many at once; above those of the
               free body the plates are clear of it, and it recovers by itself under no stress

    Each time is one step, second order in its length. `InputError` for a shear.

    >>> from ngbrain.materials import NeoHooke, Prony
    >>> stretch, stress = press(Prony(NeoHooke(1000.0), [0.5], [2.0]), "planar", [0.0, 2.0, 2.1], [0.9, 0.9, 1.0])
    >>> stretch.round(4), stress.round(1)
    (array([0.9   , 0.9   , 0.9668]), array([-471.7, -322.6,    0. ]))
    """
    test, times = _test(material, mode), _checked_times(times)
    if not test.rest:
        raise InputError("mode", repr(mode), "one that presses: uniaxial, equibiaxial or planar")
    values = _checked_histories(test, times, stretches)
    warn_beyond(material, test, np.minimum(values, test.rest))
    rows = values.reshape(-1, len(times))
    march = _March(material, test, len(rows))
    specimen = march.specimen
    specimen.state = test.isotropic(np.full(len(rows), test.rest))
    found, stress = np.empty_like(rows), np.empty_like(rows)
    for n, dt in enumerate(np.diff(times, prepend=times[0])):
        march.begin(dt)
        march.hold(rows[:, n])
        held, stress[:, n] = specimen.state, np.minimum(specimen.stress, 0.0)
        free = specimen.stress > 0
        if free.any():
            specimen.find_equilibrium(0)
            specimen.state = np.where(free, specimen.state, held)
        found[:, n] = specimen.state[0]
        march.end()
    return found.reshape(values.shape), stress.reshape(values.shape)


def creep(material: Viscous, mode: str, stress: ArrayLike, times: ArrayLike) -> np.ndarray:
    """Stretch (or shear) at `times` (s, increasing from 0) under a nominal stress (Pa): a number, sudden, or one for each time.

    Each time is one step, second order in its length. An equibiaxial test carries the stress both ways.

    >>> from ngbrain.materials import NeoHooke, Prony
    >>> creep(Prony(NeoHooke(1000.0), g=[0.5], tau=[2.0]), "shear", 100.0, np.linspace(0, 100, 2001))[[0, -1]]
    array([0.1, 0.2])
    """
    test, times = _test(material, mode), _checked_times(times)
    loads = np.asarray(stress, dtype=float)
    if loads.shape not in ((), times.shape) or not np.isfinite(loads).all():
        raise InputError("stress", stress, "a finite number (Pa), or one for each time")
    march = _March(material, test, 1)
    march.specimen.state = test.isotropic(np.array([test.rest]))
    stretches = []
    for dt, load in zip(np.diff(times, prepend=times[0]), np.broadcast_to(loads, times.shape), strict=True):
        march.begin(dt)
        march.specimen.find_equilibrium(0, load=load)
        march.end()
        stretches.append(march.specimen.state[0, 0])
    return np.array(stretches)


def storage_loss(material: Viscous, omega: ArrayLike) -> np.ndarray:
    """G*(ω) = μ_∞ + Σ μ_k iωτ_k/(1 + iωτ_k) (Pa), complex, of small strain; ω in rad/s, ≥ 0.

    >>> from ngbrain.materials import NeoHooke, Prony
    >>> storage_loss(Prony(NeoHooke(1000.0), g=[0.5], tau=[2.0]), [0.5])
    array([750.+250.j])
    """
    _test(material, "shear")
    moduli = [number(initial_modulus(branch.law)) for branch in material.branches]
    total = sum(moduli) + number(initial_modulus(material.equilibrium))
    series = PronySeries(total, [mu / total for mu in moduli], [number(branch.tau) for branch in material.branches])
    return np.asarray(series(np.asarray(omega, dtype=float)))


def _test(material: Viscous, mode: str) -> Mode:
    if not isinstance(material, Viscous):
        raise InputError(
            "material", describe_law(material), "a relaxing one, such as Viscous(law) or Prony(law, g, tau)"
        )
    check_homogeneous(material.instantaneous)
    for branch in material.branches:
        if isinstance(branch.tau, CoefficientFunction) and not hasattr(branch.tau, "Get"):
            raise InputError("tau", "a CoefficientFunction", "a number or an ngsolve Parameter")
    return find_mode(mode)


def _checked_times(times: ArrayLike, from_rest: bool = True) -> np.ndarray:
    values = np.asarray(times, dtype=float)
    start = values.size and (values[0] == 0 if from_rest else values[0] >= 0)
    if values.ndim != 1 or not start or not np.isfinite(values).all() or np.any(np.diff(values) <= 0):
        raise InputError("times", times, f"seconds in increasing order, from {'0' if from_rest else '0 or later'} on")
    return values


def _checked_histories(test: Mode, times: np.ndarray, stretches: ArrayLike) -> np.ndarray:
    values = test.check_stretches(stretches)
    if values.ndim not in (1, 2) or values.shape[-1] != len(times):
        raise InputError("stretches", f"of shape {values.shape}", f"({len(times)},) or (histories, {len(times)})")
    return values


def _symmetric(material: Viscous, test: Mode, times: np.ndarray, stretches: np.ndarray) -> np.ndarray | None:
    """All times at once in the symmetric state, or None where that is no equilibrium."""
    specimen = Specimen.from_law(material.equilibrium, test, stretches.size)
    specimen.state = test.isotropic(stretches.ravel())
    force = specimen.force
    specimen.check_finite_energy(stretches.ravel(), specimen.energy + force.sum(axis=0))
    F, dF = specimen.deformation_gradient()
    for branch in material.branches:
        H = branch.overstress(specimen.points, specimen.C, times).reshape(-1, 3, 3)
        force = force + np.einsum("nij,njk,nika->an", F, H, dF, optimize=True)
    specimen.check_finite_energy(stretches.ravel(), force.sum(axis=0))
    transverse = force[test.given :]
    if transverse.size and np.abs(transverse).max() > STATIONARY * np.abs(force).max():
        return None
    return force[0].reshape(stretches.shape)


def _stepped(material: Viscous, test: Mode, times: np.ndarray, stretches: np.ndarray) -> np.ndarray:
    """One time after the other, the body choosing its transverse strains in each."""
    march = _March(material, test, len(stretches))
    answer = np.empty_like(stretches)
    for n, dt in enumerate(np.diff(times, prepend=times[0])):
        march.begin(dt)
        if n == 0:
            march.specimen.stretch_to(stretches[:, 0])
        march.hold(stretches[:, n])
        answer[:, n] = march.specimen.stress
        march.end()
    return answer


class _March:
    """Time steps as energies, W_∞ + Σ β_k W_k + ½ Σ (e_k H_k - β_k S̄_k) : C + Maxwell branches; the first is sudden."""

    def __init__(self, material: Viscous, test: Mode, count: int) -> None:
        hereditary = material.hereditary_branches
        self._tau = np.array([number(branch.tau) for branch in hereditary])
        self._beta = [ngs.Parameter(1.0) for _ in hereditary]
        points = Points.line(count)
        self._memory = points.field(np.zeros((9, count)))
        memory = ngs.CF(tuple(self._memory[i] for i in range(9)), dims=(3, 3))
        self._flows = Flows(
            points, [Flow(points, branch.slopes, number(branch.eta)) for branch in material.maxwell_branches]
        )
        self._sudden = SUDDEN * min((number(branch.tau) for branch in material.maxwell_branches), default=1.0)

        def energy(at: Deformation) -> CoefficientFunction:
            hereditary = material.density(at, self._beta) + 0.5 * ngs.InnerProduct(memory, at.C)
            return hereditary + self._flows.energy(at.C) if self._flows else hereditary

        self.specimen = Specimen(energy, test, count, describe_law(material))
        C = self.specimen.C
        self._stress = [branch.stress(C).Compile() for branch in hereditary]
        self._shape = to_voigt(C).Compile()
        self._before = np.outer(REST, np.ones(count))
        self._S = self._H = np.zeros((len(hereditary), 9, count))
        self._factors = np.zeros((len(hereditary), 1, 1)), np.ones((len(hereditary), 1, 1))

    def begin(self, dt: float) -> None:
        """Set up the step of `dt` seconds from the state reached."""
        e, beta = step_factors(dt, self._tau)
        for parameter, value in zip(self._beta, beta, strict=True):
            parameter.Set(value)
        self._factors = e[:, None, None], beta[:, None, None]
        memory = self._factors[0] * self._H - self._factors[1] * self._S
        self.specimen.points.put(self._memory, memory.sum(axis=0))
        if self._flows:
            self._flows.begin(dt or self._sudden, self._before)
            self.specimen.follow = [self._relax]
            self._relax()

    def hold(self, stretches: np.ndarray) -> None:
        """Put the test to these stretches (n,) from the present state on; the body chooses the rest."""
        given = self.specimen.mode.given
        state = self.specimen.state.copy()
        state[:given] = stretches
        self.specimen.state = state
        self.specimen.find_equilibrium(given)

    def _relax(self) -> None:
        self._flows.relax(self.specimen.points(self._shape))
        self._flows.stiffen()

    def end(self) -> None:
        """Carry the history over."""
        e, beta = self._factors
        points = self.specimen.points
        S = np.array([points(stress) for stress in self._stress]).reshape(self._S.shape)
        self._H, self._S = e * self._H + beta * (S - self._S), S
        self._before = points(self._shape)
        self._flows.finish(self._before)
