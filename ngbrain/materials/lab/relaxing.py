"""Viscoelastic materials in homogeneous tests: stress histories, relaxation, creep, complex modulus."""

from __future__ import annotations

import ngsolve as ngs
import numpy as np
from ngsolve import CoefficientFunction
from numpy.typing import ArrayLike

from ngbrain.errors import InputError
from ngbrain.materials.base import Deformation
from ngbrain.materials.lab.modes import Mode, find_mode
from ngbrain.materials.lab.specimen import STATIONARY, Specimen, check_homogeneous, message_text, warn_beyond
from ngbrain.materials.maxwell import REST, SUDDEN, MaxwellTerm, MaxwellVariables
from ngbrain.materials.modulus import PronySeries
from ngbrain.materials.points import Points, initial_modulus, number
from ngbrain.materials.viscous import Viscous, step_factors
from ngbrain.tensors import to_voigt

RAMP_STEPS = 200


def history(material: Viscous, mode: str, times: ArrayLike, stretches: ArrayLike) -> np.ndarray:
    """Nominal stress over time under prescribed stretches.

    Exact where the stresses of the branches are linear in time within each step, else of second order in the steps.

    Parameters
    ----------
    material : Viscous
        Viscoelastic material.
    mode : str
        As for `stress`.
    times : array_like of shape (times)
        Times (s), increasing from 0 on.
    stretches : array_like
        Stretches at these times, (times,) or (histories, times); that at time 0 is applied suddenly (H = S̄ in
        every branch).

    Returns
    -------
    numpy.ndarray
        Nominal stress (Pa), of the shape of `stretches`.

    Raises
    ------
    InputError
        Inadmissible times, stretches or material.
    ConvergenceError
        No equilibrium is found.

    Examples
    --------
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
    """Relaxation test: nominal stress at constant stretch after a ramp.

    Parameters
    ----------
    material : Viscous
        Viscoelastic material.
    mode : str
        As for `stress`.
    stretch : float
        The constant stretch.
    times : array_like of shape (times)
        Times (s), increasing, at least 0.
    rise : float, default 0.0
        Duration of the ramp from rest (s); without a ramp the stretch is applied suddenly, and the result is exact
        at any times.

    Returns
    -------
    numpy.ndarray
        Nominal stress (Pa) at these times.

    Raises
    ------
    InputError
        An inadmissible value.

    Examples
    --------
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
    """Compression between plates that are not bonded: stretch and nominal stress; the plates press but never pull.

    Each time is one step, of second order in its length.

    Parameters
    ----------
    material : Viscous
        Viscoelastic material.
    mode : str
        "uniaxial", "equibiaxial" or "planar".
    times : array_like of shape (times)
        Times (s), increasing from 0 on.
    stretches : array_like
        Stretches that the plates prescribe, (times,) or (histories, times). Above those of the free body the plates
        are out of contact, and the body recovers without stress.

    Returns
    -------
    tuple of (numpy.ndarray, numpy.ndarray)
        Stretch and nominal stress (Pa), of the shape of `stretches`.

    Raises
    ------
    InputError
        A shear test, or an inadmissible value.

    Examples
    --------
    >>> from ngbrain.materials import NeoHooke, Prony
    >>> stretch, stress = press(Prony(NeoHooke(1000.0), [0.5], [2.0]), "planar", [0.0, 2.0, 2.1], [0.9, 0.9, 1.0])
    >>> stretch.round(4), stress.round(1)
    (array([0.9   , 0.9   , 0.9668]), array([-471.7, -322.6,    0. ]))
    """
    test, times = _test(material, mode), _checked_times(times)
    if not test.rest:
        raise InputError("mode", repr(mode), "a compression test: uniaxial, equibiaxial or planar")
    values = _checked_histories(test, times, stretches)
    warn_beyond(material, test, np.minimum(values, test.rest))
    rows = values.reshape(-1, len(times))
    march = _TimeMarch(material, test, len(rows))
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
    """Creep test: stretch (or shear) over time under a prescribed nominal stress.

    Each time is one step, of second order in its length. An equibiaxial test carries the stress in both directions.

    Parameters
    ----------
    material : Viscous
        Viscoelastic material.
    mode : str
        As for `stress`.
    stress : array_like
        Nominal stress (Pa): a number, applied suddenly, or one value per time.
    times : array_like of shape (times)
        Times (s), increasing from 0 on.

    Returns
    -------
    numpy.ndarray
        Stretch, or amount of shear, at these times.

    Raises
    ------
    InputError
        An inadmissible value.

    Examples
    --------
    >>> from ngbrain.materials import NeoHooke, Prony
    >>> creep(Prony(NeoHooke(1000.0), g=[0.5], tau=[2.0]), "shear", 100.0, np.linspace(0, 100, 2001))[[0, -1]]
    array([0.1, 0.2])
    """
    test, times = _test(material, mode), _checked_times(times)
    loads = np.asarray(stress, dtype=float)
    if loads.shape not in ((), times.shape) or not np.isfinite(loads).all():
        raise InputError("stress", stress, "a finite number (Pa), or one for each time")
    march = _TimeMarch(material, test, 1)
    march.specimen.state = test.isotropic(np.array([test.rest]))
    stretches = []
    for dt, load in zip(np.diff(times, prepend=times[0]), np.broadcast_to(loads, times.shape), strict=True):
        march.begin(dt)
        march.specimen.find_equilibrium(0, load=load)
        march.end()
        stretches.append(march.specimen.state[0, 0])
    return np.array(stretches)


def storage_loss(material: Viscous, omega: ArrayLike) -> np.ndarray:
    """Complex shear modulus at small strain, G*(ω) = μ_∞ + Σ μ_k iωτ_k/(1 + iωτ_k).

    Parameters
    ----------
    material : Viscous
        Viscoelastic material.
    omega : array_like
        Angular frequency ω (rad/s), at least 0.

    Returns
    -------
    numpy.ndarray
        G* (Pa), complex.

    Examples
    --------
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
            "material", message_text(material), "a viscoelastic one, such as Viscous(law) or Prony(law, g, tau)"
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
    """Stress at all times at once in the symmetric state, or None where that is not in equilibrium."""
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
    """Stress by time steps, each with its own transverse equilibrium."""
    march = _TimeMarch(material, test, len(stretches))
    answer = np.empty_like(stretches)
    for n, dt in enumerate(np.diff(times, prepend=times[0])):
        march.begin(dt)
        if n == 0:
            march.specimen.stretch_to(stretches[:, 0])
        march.hold(stretches[:, n])
        answer[:, n] = march.specimen.stress
        march.end()
    return answer


class _TimeMarch:
    """Time steps as energies, W_∞ + Σ β_k W_k + ½ Σ (e_k H_k - β_k S̄_k) : C + Maxwell branches; the first step is sudden."""

    def __init__(self, material: Viscous, test: Mode, count: int) -> None:
        hereditary = material.hereditary_branches
        self._tau = np.array([number(branch.tau) for branch in hereditary])
        self._beta = [ngs.Parameter(1.0) for _ in hereditary]
        points = Points.line(count)
        self._memory = points.field(np.zeros((9, count)))
        memory = ngs.CF(tuple(self._memory[i] for i in range(9)), dims=(3, 3))
        self._maxwell = MaxwellTerm(
            points,
            [MaxwellVariables(points, branch.slopes, number(branch.eta)) for branch in material.maxwell_branches],
        )
        self._sudden = SUDDEN * min((number(branch.tau) for branch in material.maxwell_branches), default=1.0)

        def energy(at: Deformation) -> CoefficientFunction:
            hereditary = material.density(at, self._beta) + 0.5 * ngs.InnerProduct(memory, at.C)
            return hereditary + self._maxwell.energy(at.C) if self._maxwell else hereditary

        self.specimen = Specimen(energy, test, count, message_text(material))
        C = self.specimen.C
        self._stress = [branch.stress(C).Compile() for branch in hereditary]
        self._shape = to_voigt(C).Compile()
        self._before = np.outer(REST, np.ones(count))
        self._S = self._H = np.zeros((len(hereditary), 9, count))
        self._factors = np.zeros((len(hereditary), 1, 1)), np.ones((len(hereditary), 1, 1))

    def begin(self, dt: float) -> None:
        """Set up the step of `dt` seconds from the present state."""
        e, beta = step_factors(dt, self._tau)
        for parameter, value in zip(self._beta, beta, strict=True):
            parameter.Set(value)
        self._factors = e[:, None, None], beta[:, None, None]
        memory = self._factors[0] * self._H - self._factors[1] * self._S
        self.specimen.points.put(self._memory, memory.sum(axis=0))
        if self._maxwell:
            self._maxwell.begin(dt or self._sudden, self._before)
            self.specimen.follow = [self._relax]
            self._relax()

    def hold(self, stretches: np.ndarray) -> None:
        """Prescribe these stretches (n,), starting from the present state; the other entries minimise the energy."""
        given = self.specimen.mode.given
        state = self.specimen.state.copy()
        state[:given] = stretches
        self.specimen.state = state
        self.specimen.find_equilibrium(given)

    def _relax(self) -> None:
        self._maxwell.relax(self.specimen.points(self._shape))
        self._maxwell.stiffen()

    def end(self) -> None:
        """Update the internal variables."""
        e, beta = self._factors
        points = self.specimen.points
        S = np.array([points(stress) for stress in self._stress]).reshape(self._S.shape)
        self._H, self._S = e * self._H + beta * (S - self._S), S
        self._before = points(self._shape)
        self._maxwell.finish(self._before)
