"""Elastography phantoms: squares with simulated, noisy wave measurements.

The cases are published (Awasthi et al. 2023, 10.1016/j.advengsoft.2023.103476), reproduced in their discretisation: 120 mm wide
in plane strain, bilinear displacements on a grid of squares, one pressure per square where nearly incompressible, bilinear
moduli. One edge moves by 1 mm. Data and inversion share the mesh (inverse crime), so that without noise every fit is perfect:
noise-free results show the speed of a method, not its accuracy.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace

import ngsolve as ngs
import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg

from ngbrain.adjoint.reduced import Reduced, Regulariser
from ngbrain.errors import InputError, SolverError, nearest
from ngbrain.forward.harmonic.problem import HarmonicProblem
from ngbrain.forward.harmonic.wave import Wave
from ngbrain.forward.sensitivity.harmonic.wave_model import BOUNDARY, WaveModel
from ngbrain.inverse.objective.misfit import LeastSquares
from ngbrain.inverse.objective.parameters import LogTransform, ParameterFields, ScaledTransform, Unknown
from ngbrain.inverse.objective.regularisation import smooth
from ngbrain.inverse.optimise.quasi_newton import bfgs_iterations
from ngbrain.io.waves import WaveData
from ngbrain.look import BriefText
from ngbrain.materials import Shearing, TransverselyIsotropic
from ngbrain.mesh.geometry.structured import rectangles
from ngbrain.solvers.device import CPU, Device

Array = np.ndarray
SIDE, DRIVE = 0.12, 1e-3
"""Edge length, and displacement of the driven edge (m)."""
TI_BULK, TI_ANGLE = 5e5, 30.0
UNITS = {"zeta": 2.0, "phi": 0.2}
LOGS = {"zeta": LogTransform(-0.75), "phi": LogTransform(-1.0)}
MIXED_ABOVE = 0.4
"""Poisson's ratio above which the pressure is an unknown."""
EXACT = 1e-4
"""Noise level that weights the misfit of noise-free data, relative to the rms: with less, a Gauss-Newton step leaves its range of
validity.
"""

Drive = Mapping[str, tuple[float | None, float | None]]


def _gaussian(x: Array, y: Array) -> Array:
    return np.exp(-((x - SIDE / 2) ** 2 + (y - SIDE / 2) ** 2) / 4e-4)


def _inclusion(x: Array, y: Array) -> dict[str, Array]:
    return {"youngs": 1e4 + 5e3 * _gaussian(x, y)}


def _halves(x: Array, y: Array) -> dict[str, Array]:
    return {"youngs": np.where(y > SIDE / 2 + 1e-9, 1e4, 2e4)}


def _viscoelastic_inclusion(x: Array, y: Array) -> dict[str, Array]:
    return {"storage": 1e4 + 5e3 * _gaussian(x, y), "loss": 1e3 + 5e2 * _gaussian(x, y)}


def _viscoelastic_halves(x: Array, y: Array) -> dict[str, Array]:
    soft = y > SIDE / 2 + 1e-9
    return {"storage": np.where(soft, 1e4, 2e4), "loss": np.where(soft, 1e3, 2e3)}


def _fibrous_inclusion(x: Array, y: Array) -> dict[str, Array]:
    return {"mu": 1e4 + 5e3 * _gaussian(x, y), "zeta": 0.5 + 2 * _gaussian(x, y), "phi": 0.2 + 0.2 * _gaussian(x, y)}


@dataclass(frozen=True, repr=False)
class Phantom(BriefText):
    """Square phantom and its excitation.

    Parameters
    ----------
    nodes : int
        Nodes along an edge.
    frequency : float or tuple of float
        Frequency (Hz); with several, each excitation is applied at each of them.
    poisson : float or None
        Poisson's ratio; None for the transversely isotropic phantom, whose fibres are at 30°.
    truth : callable
        x, y (m) ↦ fields by name: youngs, or storage and loss, or mu (Pa), zeta, phi.
    start : mapping of str to float
        Uniform initial guess of the inversions of this case.
    drives : tuple of mapping
        Excitations: displacement (m) by edge, None for a component that slides. Each is a load.
    bulk : float
        Bulk modulus (Pa) of the transversely isotropic phantom.
    """

    nodes: int
    frequency: float | tuple[float, ...]
    poisson: float | None
    truth: Callable[[Array, Array], dict[str, Array]]
    start: Mapping[str, float]
    drives: tuple[Drive, ...] = ({"top": (DRIVE, 0)},)
    bulk: float = TI_BULK

    @property
    def loads(self) -> list[tuple[float, Drive]]:
        """Frequency and excitation of each load."""
        several = self.frequency if isinstance(self.frequency, tuple) else (self.frequency,)
        return [(frequency, drive) for frequency in several for drive in self.drives]

    @staticmethod
    def from_name(name: str, nodes: int | None = None) -> Phantom:
        """One of `PHANTOMS`, optionally with another number of nodes along an edge.

        Parameters
        ----------
        name : str
            Name of the phantom.
        nodes : int, optional
            Nodes along an edge.

        Returns
        -------
        Phantom

        Raises
        ------
        InputError
            If there is no such phantom.

        Examples
        --------
        >>> Phantom.from_name("CV-G", 25).nodes
        25
        """
        if name not in PHANTOMS:
            raise InputError("phantom", repr(name), nearest(name, list(PHANTOMS)))
        return replace(PHANTOMS[name], nodes=nodes or PHANTOMS[name].nodes)

    def simulate_measurements(self, noise: float = 0.0, seed: int = 0) -> PhantomData:
        """Simulate waves at the nodes with Gaussian noise η = noise · rms(component) (a + ib)/√2, a and b standard normal.

        Parameters
        ----------
        noise : float
            Noise level relative to the rms.
        seed : int
            Seed.

        Returns
        -------
        PhantomData

        Examples
        --------
        >>> Phantom.from_name("CV-G", 5).simulate_measurements(0.01).displacement.shape
        (1, 25, 2)
        """
        grid = _Square(self)
        exact = grid.simulate(self.truth(*grid.points.T))
        rms = np.sqrt(np.mean(np.abs(exact) ** 2, axis=1, keepdims=True))
        random = np.random.default_rng(seed)
        unit_noise = random.normal(size=(*exact.shape, 2)) @ [1, 1j] / np.sqrt(2)
        return PhantomData(self, grid.points, exact + noise * rms * unit_noise, rms, noise)


class _Square:
    def __init__(self, phantom: Phantom) -> None:
        line = np.linspace(0, SIDE, phantom.nodes)
        self.phantom, self.mesh = phantom, rectangles(line, line)
        self.space = ngs.H1(self.mesh, order=1)
        self.points = np.array([v.point for v in self.mesh.vertices])

    def simulate(self, values: Mapping[str, Array]) -> Array:
        """Waves (loads, n, 2) of the excitations; each prescribes other components and edges, so that the matrix has none."""
        factors, n = self.model(values).body.factorise(), len(self.points)
        edges = dict(zip(("left", "bottom"), np.isclose(self.points, 0).T, strict=True))
        edges |= dict(zip(("right", "top"), np.isclose(self.points, SIDE).T, strict=True))
        found = []
        for load, (_, drive) in enumerate(self.phantom.loads):
            matrix = factors.matrix(load)
            g = np.full(matrix.shape[0], np.nan)
            for edge, way in drive.items():
                for i, value in enumerate(way):
                    if value is not None:
                        g[i * n : (i + 1) * n][edges[edge]] = value
            held = ~np.isnan(g)
            u = np.where(held, g, 0).astype(complex)
            free = sp.csc_array(matrix[~held][:, ~held])
            u[~held] = scipy.sparse.linalg.splu(free).solve(-(matrix @ u)[~held])
            found.append(u[: 2 * n].reshape(2, n).T)
        return np.array(found)

    def model(self, values: Mapping[str, Array | float], device: Device = CPU) -> WaveModel:
        """Wave model with all edges prescribed, at values that are set later."""
        fields = {name: ngs.GridFunction(self.space) for name in values}
        for name, value in values.items():
            fields[name].vec.FV().NumPy()[:] = value
        nu, waves = self.phantom.poisson, [Wave(frequency) for frequency, _ in self.phantom.loads]
        if nu is None:
            angle = np.deg2rad(TI_ANGLE)
            fibre = np.cos(angle), np.sin(angle)
            law = TransverselyIsotropic(fields["mu"], fields["zeta"], fields["phi"], fibre)
            body = HarmonicProblem(
                self.mesh, law, waves, bulk=self.phantom.bulk, form="Q1", quadrature=1, device=device
            )
        else:
            shear = fields["youngs"] / (2 * (1 + nu)) if "youngs" in fields else fields["storage"] + 1j * fields["loss"]
            form = "Q1/L2(0)" if nu > MIXED_ABOVE else "Q1"
            bulk = 2 * (1 + nu) / (3 * (1 - 2 * nu)) * shear
            body = HarmonicProblem(self.mesh, Shearing(shear), waves, bulk=bulk, form=form, quadrature=1, device=device)
        return WaveModel(body, fields, self.points)


@dataclass(frozen=True, repr=False)
class PhantomData(BriefText):
    """Simulated measurements of a phantom.

    Parameters
    ----------
    phantom : Phantom
        Phantom.
    points : array (n, 2)
        Points (m).
    displacement : array (loads, n, 2)
        Complex displacement (m).
    rms : array (loads, 1, 2)
        Root mean square of each component without noise (m).
    noise : float
        Noise level relative to it.
    truth : mapping
        Property → true values at the points; made from the phantom.
    """

    phantom: Phantom
    points: Array
    displacement: Array
    rms: Array
    noise: float
    truth: dict[str, Array] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "truth", self.phantom.truth(*self.points.T))

    @property
    def sigma(self) -> Array:
        """Standard deviation (m) of real and imaginary parts; `EXACT` of the rms for noise-free data."""
        return max(self.noise, EXACT) * self.rms / np.sqrt(2)

    def errors(self, found: Mapping[str, Array]) -> dict[str, float]:
        """Relative error ‖found - truth‖/‖truth‖ over the nodes, by name."""
        return {name: float(np.linalg.norm(found[name] - t) / np.linalg.norm(t)) for name, t in self.truth.items()}

    def inversion(
        self,
        regularised: Callable[[ngs.FESpace, Array], Regulariser] = smooth,
        weight: float = 1e3,
        start: Mapping[str, Array | float] | None = None,
        device: Device = CPU,
    ) -> PhantomInversion:
        """Inverse problem on the same grid; all edges are prescribed by the measurements, whose noise makes them unknown.

        Parameters
        ----------
        regularised : callable
            Constructor of a regulariser from a space and x̄, the same for each field.
        weight : float
            Initial weight of each.
        start : mapping of str to array or float, optional
            Initial guess. Default that of the phantom.
        device : Device
            Device that factorises matrices.

        Returns
        -------
        PhantomInversion

        Examples
        --------
        >>> Phantom.from_name("CV-G", 5).simulate_measurements(0.01).inversion().start.shape
        (114,)
        """
        phantom, grid = self.phantom, _Square(self.phantom)
        begin = dict(start or phantom.start)
        model = grid.model(begin, device)
        theta, where = model.theta, model.blocks[BOUNDARY]
        sigma = np.broadcast_to(self.sigma, self.displacement.shape)
        theta[where] = self._boundary_values(model, self.displacement)
        unknowns = {name: Unknown(value, LOGS.get(name, LogTransform())) for name, value in begin.items()}
        if self.noise:
            unknowns[BOUNDARY] = Unknown(theta[where], ScaledTransform(self._boundary_values(model, sigma * (1 + 1j))))
        fields = ParameterFields(theta, model.blocks, unknowns)
        regularisers = {name: regularised(grid.space, fields.start[fields.blocks[name]]) for name in begin}
        misfit = LeastSquares(self.displacement, sigma)
        return PhantomInversion(self, Reduced(model, misfit, fields, regularisers, dict.fromkeys(begin, weight)))

    def data(self) -> WaveData:
        """The same measurements as `WaveData`, for methods that start from these."""
        phantom, truth = self.phantom, self.truth
        return WaveData(
            self.points,
            self.displacement,
            np.array([frequency for frequency, _ in phantom.loads]),
            1000.0,
            "isotropic" if phantom.poisson else "transversely_isotropic",
            "viscoelastic" if "loss" in truth else "elastic",
            poisson=phantom.poisson,
            bulk=None if phantom.poisson else phantom.bulk,
            fibre=None if phantom.poisson else np.array([np.cos(np.deg2rad(TI_ANGLE)), np.sin(np.deg2rad(TI_ANGLE))]),
            element="q4p0" if phantom.poisson and phantom.poisson > MIXED_ABOVE else "q4",
            noise=self.noise,
            truth={"shear": truth["storage"] + 1j * truth["loss"]} if "loss" in truth else truth,
        )

    def published_iterations(self) -> Iterator[PublishedIteration]:
        """Iterations of the published inversion, by BFGS from the uniform initial guess.

        It minimises Φ = ½ Σ |u - m|² (mm²) over moduli in MPa (ζ in 2, φ in 0.2), without regulariser, bounds or noise model; the
        boundary is exactly as measured.

        It ends where no step lowers Φ. The publication used the line search of a commercial code, so that the iterates differ.

        >>> iterate = next(Phantom.from_name("CV-G", 5).simulate_measurements(0.01).published_iterations())
        >>> iterate.number, sorted(iterate.fields)
        (1, ['loss', 'storage'])
        """
        phantom = self.phantom
        model = _Square(phantom).model(phantom.start)
        theta, where = model.theta, model.blocks[BOUNDARY]
        theta[where] = self._boundary_values(model, self.displacement)
        unit = np.concatenate([np.full(len(self.points), UNITS.get(name, 1e6)) for name in phantom.start])

        def value(x: Array) -> tuple[float, Array]:
            theta[: where.start] = unit * x
            try:
                state = model.evaluate(theta)
            except SolverError:
                return np.inf, np.zeros_like(x)
            off = state.data - self.displacement
            return 5e5 * float(np.sum(np.abs(off) ** 2)), 1e6 * unit * state.gradient(off)[: where.start]

        def found(number: int, x: Array, misfit: float) -> PublishedIteration:
            return PublishedIteration(number, misfit, {name: (unit * x)[model.blocks[name]] for name in phantom.start})

        x = theta[: where.start] / unit
        yield from (found(*iterate) for iterate in bfgs_iterations(value, x))

    @staticmethod
    def _boundary_values(model: WaveModel, values: Array) -> Array:
        parts = [u.T.ravel()[model.driven_dofs] for u in values]
        return np.concatenate([part for u in parts for part in (u.real, u.imag)])


@dataclass(frozen=True, repr=False)
class PublishedIteration(BriefText):
    """Iteration of the published inversion.

    Parameters
    ----------
    number : int
        Iteration number.
    misfit : float
        Misfit (mm²).
    fields : dict of str to array
        Fields (Pa).
    """

    number: int
    misfit: float
    fields: dict[str, Array]


@dataclass(frozen=True)
class PhantomInversion:
    """Inverse problem of a phantom.

    Parameters
    ----------
    measured : PhantomData
        Measurements.
    reduced : Reduced
        Objective.
    """

    measured: PhantomData
    reduced: Reduced

    @property
    def model(self) -> WaveModel:
        """Wave model."""
        assert isinstance(self.reduced.model, WaveModel)
        return self.reduced.model

    @property
    def start(self) -> Array:
        """Initial guess x."""
        return self.reduced.unknowns.start

    @property
    def waves(self) -> Array:
        """Measured waves as unknowns of the waves (loads, ndof) with zero pressures, from which `GaussNewton.from_waves` starts."""
        whole = np.zeros((len(self.measured.displacement), self.model.body.fes.ndof), complex)
        flat = [u.T.ravel() for u in self.measured.displacement]
        whole[:, : len(flat[0])] = flat
        return whole

    def errors(self, x: Array) -> dict[str, float]:
        """Relative error ‖found - truth‖/‖truth‖ over the nodes, by name."""
        return self.measured.errors(self.fields(x))

    def fields(self, x: Array) -> dict[str, Array]:
        """Nodal values by name."""
        unknowns = self.reduced.unknowns
        assert isinstance(unknowns, ParameterFields)
        return unknowns.values(x)


_SIDEWAYS: Drive = {"bottom": (None, DRIVE), "left": (0.0, None), "top": (None, 0.0)}
PHANTOMS = {
    "CE-G": Phantom(101, 50, 0.3, _inclusion, {"youngs": 1.1e4}),
    "CE-B": Phantom(101, 80, 0.3, _halves, {"youngs": 1e4}),
    "CV-G": Phantom(51, 50, 0.3, _viscoelastic_inclusion, {"storage": 1e4, "loss": 1e3}),
    "CV-B": Phantom(51, 100, 0.3, _viscoelastic_halves, {"storage": 1e4, "loss": 1e3}),
    "NE-G": Phantom(81, 50, 0.4995, _inclusion, {"youngs": 1.1e4}),
    "NV-G": Phantom(51, 100, 0.49, _viscoelastic_inclusion, {"storage": 1e4, "loss": 1e3}),
    "TI": Phantom(
        51, 50, None, _fibrous_inclusion, {"mu": 1e4, "zeta": 0.5, "phi": 0.2}, ({"top": (DRIVE, 0)}, _SIDEWAYS)
    ),
}
"""Compressible or nearly incompressible (C, N), elastic or viscoelastic (E, V), Gaussian inclusion or halves (G, B); fibres."""
