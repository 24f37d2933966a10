"""Time-harmonic waves of small amplitude, u(x, t) = Re(u(x) e^{iωt}), in elastic and viscoelastic bodies.

For every wave find u with u = g where it is held and, for all v that are zero there,

    ∫ ∂W/∂ε(ε(u)) : ε(v) - ω² ρ u·v  +  iω ∫_absorbing (z_p (u·n)(v·n) + z_s u_t·v_t)  =  ∫ f·v + ∫ t·v

W is a quadratic energy with complex moduli, written without conjugates: the matrix is complex-symmetric, so its factor serves
the adjoint too. With motion through the plane (`AntiPlane`) u is one number and ∂W/∂ε:ε(v) = G ∇u·∇v. Nearly incompressible
bodies take the pressure p as one more unknown, W = W_shape(ε) + p tr ε - p²/2K. ω = 0 is the quasi-static case.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import ngsolve as ngs
import numpy as np
from ngsolve import CoefficientFunction
from ngsolve.comp import IntegrationRuleSpace

from ngbrain import parallel
from ngbrain.errors import InputError
from ngbrain.forward.common.elements import ElementPair
from ngbrain.forward.common.kinematics import AntiPlane, PlaneStrain, Solid, kinematics_of
from ngbrain.forward.common.regions import boundaries
from ngbrain.forward.common.solve_counts import Solves
from ngbrain.forward.harmonic.factors import Factorised
from ngbrain.materials.base import Value, positive
from ngbrain.materials.linear import OfSmallStrain
from ngbrain.solvers.device import CPU, Device

Array = np.ndarray
Vector: TypeAlias = Sequence[Value] | CoefficientFunction
LawOfFrequency: TypeAlias = OfSmallStrain | Callable[[float], OfSmallStrain]
"""A law of ε with complex moduli, or a function that gives it for ω (rad/s)."""


@dataclass(frozen=True)
class Wave:
    """What drives the body at one frequency (Hz, 0 for quasi-static).

    held      boundary pattern → displacement amplitude (m, complex), for boundaries among those that the body is held at
    traction  boundary pattern → force per area (Pa, complex)
    force     per volume (N/m³, complex)
    """

    frequency: float
    held: Mapping[str, Vector] = field(default_factory=dict)
    traction: Mapping[str, Vector] = field(default_factory=dict)
    force: Vector | None = None

    def __post_init__(self) -> None:
        if not (isinstance(self.frequency, (int, float)) and 0 <= self.frequency < math.inf):
            raise InputError("Wave.frequency", self.frequency, "a frequency in Hz of at least 0")

    @property
    def omega(self) -> float:
        """Angular frequency (rad/s)."""
        return 2 * math.pi * self.frequency


@dataclass(frozen=True)
class Absorbing:
    """A boundary that lets plane waves out: z_p = √(ρ(K + 4G/3)) along its normal, z_s = √(ρG) across (Pa s/m).

    Exact for waves that meet it squarely. Source: Lysmer and Kuhlemeyer 1969, 10.1061/JMCEA3.0001144.
    """

    boundary: str
    shear: Value
    bulk: Value = 0.0


class Harmonic:
    """A body in which waves are looked for.

    mesh       2-D (plane strain, or `kinematics` of `Axisymmetric()` or `AntiPlane()`) or 3-D
    law        of the strain, complex moduli allowed; with `bulk` it must leave change of volume alone (`Shearing`,
               `TransverselyIsotropic`). A function of ω (rad/s) gives a law for each frequency.
    waves      the loads; those of one frequency share a factorisation
    bulk       K (Pa, complex allowed); None where the law has it all
    density    ρ (kg/m³)
    form       "P4" or, with the pressure as an unknown, "P4/P3", "P4/L2(2)"; on quadrilaterals "Q1", "Q1/L2(0)" too
    held       boundaries whose displacement each wave prescribes (0 where it says nothing): a pattern, or patterns for
               single components, {"x": "side|top", "y": "top"}
    quadrature rules of degree 2 × this on elements; unasked one more than the order
    device     where matrices are factorised, `Device.named("cuda")` for a GPU
    translation  with motion through the plane: whether the whole body also moves by a number (m) for each wave that is no part
               of u: the last unknown, prescribed as 0. Measurements leave it out where the head's motion was subtracted or an
               image of phase is known up to multiples of 2π; a pressure that changes evenly along z acts alike

    Raises `InputError` for patterns that match nothing, unstable pairs, a pressure without K, a negative density, a complex
    constant of NGSolve's as a modulus, ngs.CF(2000 + 800j): a number does, or CF(2000) + 1j * CF(800).

    >>> from ngbrain.materials import Shearing
    >>> from ngbrain.mesh.grid import rectangles
    >>> mesh = rectangles(np.linspace(0, 0.1, 9), np.linspace(0, 0.1, 9))
    >>> body = Harmonic(mesh, Shearing(2000 + 800j), [Wave(50.0, {"top": (1e-3, 0)})], bulk=2e5, held="top|bottom")
    >>> u, = body.solve()
    >>> u(mesh(0.05, 0.1))[0]
    (0.001+0j)
    """

    def __init__(
        self,
        mesh: ngs.Mesh,
        law: LawOfFrequency,
        waves: Sequence[Wave],
        *,
        bulk: Value | None = None,
        density: Value = 1000.0,
        form: str = "P4",
        held: str | Mapping[str, str] = ".*",
        absorbing: Sequence[Absorbing] = (),
        kinematics: Solid | None = None,
        quadrature: int | None = None,
        device: Device = CPU,
        translation: bool = False,
    ) -> None:
        self._how = {
            "bulk": bulk, "density": density, "form": form, "held": held, "absorbing": absorbing, "kinematics": kinematics,
            "quadrature": quadrature, "device": device, "translation": translation,
        }  # fmt: skip
        self.mesh, self.law, self.bulk, self.density = mesh, law, bulk, density
        self.waves, self.absorbing = tuple(waves), tuple(absorbing)
        self.form, self.kinematics = ElementPair.named(form), kinematics_of(mesh, kinematics)
        self.axes = "z" if isinstance(self.kinematics, AntiPlane) else "xyz"[: mesh.dim]
        """The components of the displacement."""
        axes = self._check(held)
        dirichlet = {f"dirichlet{axis}": pattern for axis, pattern in axes.items()}
        if self.axes == "z":
            self.displacement = ngs.H1(mesh, order=self.form.order, complex=True, dirichlet=axes.get("z", ""))
        else:
            self.displacement = ngs.VectorH1(mesh, order=self.form.order, complex=True, **dirichlet)
        self.translation, self.fes = translation, self.displacement
        if translation and self.axes != "z":
            raise InputError("translation", True, "False but with motion through the plane")
        if translation:
            self.fes = self.displacement * ngs.NumberSpace(mesh, complex=True)
        elif self.form.pressure is not None:
            pressures = ngs.H1 if self.form.continuous else ngs.L2
            self.fes = self.displacement * pressures(mesh, order=self.form.pressure, complex=True)
        self.device, self.device_note = device.for_unknowns(self.fes.ndof)
        self.held = ~np.fromiter(self.fes.FreeDofs(), bool, self.fes.ndof)
        self.held[self.displacement.ndof :] |= translation
        self.free = ngs.BitArray((~self.held).tolist())
        degree = self.form.order + 1 if quadrature is None else quadrature
        self.rules = IntegrationRuleSpace(mesh, order=degree).GetIntegrationRules()
        self.boundary_rules = {
            shape: ngs.IntegrationRule(shape, 2 * degree) for shape in (ngs.SEGM, ngs.TRIG, ngs.QUAD)
        }
        for omega in {wave.omega for wave in self.waves}:
            self.works(omega, *self.fes.TnT())  # what cannot be differentiated is said now
        self.prescribed = [self._prescribed(wave) for wave in self.waves]
        """Displacement amplitudes of the held unknowns (m), one array for each wave; zero elsewhere."""

    @property
    def mixed(self) -> bool:
        """Whether the pressure is an unknown."""
        return self.form.pressure is not None

    def split(
        self, whole: CoefficientFunction
    ) -> tuple[CoefficientFunction, CoefficientFunction | None, CoefficientFunction]:
        """Displacement, pressure (if there is one) and displacement gradient of a trial, test or grid function."""
        known = isinstance(whole, ngs.GridFunction)
        u, p = whole, None
        if self.mixed or self.translation:
            u, p = whole.components if known else whole
        return u, p if self.mixed else None, _gradient(u) if known else ngs.Grad(u)

    def strain(self, u: CoefficientFunction, grad: CoefficientFunction) -> CoefficientFunction:
        """ε(u): 2×2 in plane strain, else 3×3."""
        if isinstance(self.kinematics, PlaneStrain):
            return ngs.Sym(grad)
        return ngs.Sym(self.kinematics.gradient(u, grad)) - ngs.Id(3)

    def works(self, omega: float, trial: CoefficientFunction, test: CoefficientFunction) -> list[CoefficientFunction]:
        """The integrands over volume, bilinear in `trial` and `test`; from the energy, by differentiation.

        Apart, not summed: NGSolve evaluates an integrand for each pair of entries of all the gradients and values in it. In space,
        where multiplying is dearer than evaluating, what has the same gradients is one: cubes of third order take .35 s, not .56.
        """
        (u, p, grad_u), (v, q, grad_v) = self.split(trial), self.split(test)
        strain, along = self.strain(u, grad_u).MakeVariable(), self.strain(v, grad_v)
        law = self.law if isinstance(self.law, OfSmallStrain) else self.law(omega)
        works = [derivative(law.energy(strain), strain, along, "law")]
        if p is not None and self.bulk is not None:
            pressure = p.MakeVariable()
            pressing, pressed = pressure * ngs.Trace(strain), -1 / (2 * self.bulk) * pressure * pressure
            works.append(pressing.Diff(strain, along) + pressing.Diff(pressure, q))
            works.append(derivative(pressed, pressure, q, "bulk"))
        elif self.bulk is not None:
            pressed = derivative(self.bulk / 2 * ngs.Trace(strain) * ngs.Trace(strain), strain, along, "bulk")
            works = [works[0] + pressed] if self.mesh.dim == 3 else [*works, pressed]
        if self.translation:
            u, v = (sum(each.components if isinstance(each, ngs.GridFunction) else each) for each in (trial, test))
        if omega:
            works.append(-(omega**2) * self.inertia(u, v))
        return [self.kinematics.weight() * work for work in works]

    def inertia(self, u: CoefficientFunction, v: CoefficientFunction) -> CoefficientFunction:
        """ρ u·v of two displacements."""
        return self.density * _dot(u, v)

    def terms(
        self, omega: float, trial: CoefficientFunction, test: CoefficientFunction, change: Change
    ) -> Terms | None:
        """All integrals; `change` may turn an integrand into its derivative. None where nothing is left."""
        changed = map(change, self.works(omega, trial, test))
        integrals = [work * ngs.dx(intrules=self.rules) for work in changed if not vanishes(work)]
        u, v = self.split(trial)[0], self.split(test)[0]
        for wall in self.absorbing if omega else ():
            normal = ngs.specialcf.normal(self.mesh.dim)
            u_n, v_n = (ngs.CF(0.0),) * 2 if self.axes == "z" else (_dot(u, normal), _dot(v, normal))
            squeezed = ngs.sqrt(self.density * (wall.bulk + 4 / 3 * wall.shear) * ngs.CF(1))
            sheared = ngs.sqrt(self.density * wall.shear * ngs.CF(1))
            work = 1j * omega * self.kinematics.weight() * (squeezed * u_n * v_n + sheared * (_dot(u, v) - u_n * v_n))
            if not vanishes(work := change(work)):
                integrals.append(work * ngs.ds(wall.boundary, intrules=self.boundary_rules))
        return sum(integrals[1:], integrals[0]) if integrals else None

    def factorised(self, solves: Solves | None = None) -> Factorised:
        """Matrices of the moduli as they now are, and their factors, counted in `solves`."""
        return Factorised(self, solves)

    def solve(self, executor: parallel.AnyExecutor = None) -> list[ngs.GridFunction]:
        """Amplitudes (m, complex), one for each wave; with a pressure its first component is the displacement.

        executor  who solves for the waves of each frequency, on one thread (`parallel.run`), a body made anew of the same mesh and
                  moduli; by default this process. The answer does not depend on it

        Raises `SolverError` when a matrix has no usable factor, as at a resonance without loss.
        """
        of = {wave.frequency: [w for w in self.waves if w.frequency == wave.frequency] for wave in self.waves}
        if executor in (None, 1) or len(of) < 2:
            amplitudes = _amplitudes(self)
        else:
            tasks = [
                parallel.Task(f"{frequency:g} Hz", _solved, (self.mesh, self.law, waves, self._how))
                for frequency, waves in of.items()
            ]
            each = dict(zip(of, map(iter, parallel.run(tasks, executor).values()), strict=True))
            amplitudes = [next(each[wave.frequency]) for wave in self.waves]
        found = []
        for values in amplitudes:
            found.append(ngs.GridFunction(self.fes))
            found[-1].vec.FV().NumPy()[:] = values
        return found

    def pushed(self, number: int) -> Array:
        """∫ f·v + ∫ t·v of a wave."""
        wave, test = self.waves[number], self.split(self.fes.TestFunction())[0]
        if wave.force is None and not wave.traction:
            return np.zeros(self.fes.ndof, complex)
        load = ngs.LinearForm(self.fes)
        if wave.force is not None:
            load += self.kinematics.weight() * _dot(_vector(wave.force), test) * ngs.dx(intrules=self.rules)
        for boundary, traction in wave.traction.items():
            work = self.kinematics.weight() * _dot(_vector(traction), test)
            load += work * ngs.ds(boundary, intrules=self.boundary_rules)
        load.Assemble()
        return load.vec.FV().NumPy().copy()

    def _check(self, held: str | Mapping[str, str]) -> dict[str, str]:
        """Patterns by axis, when all that was given makes sense."""
        if not self.waves:
            raise InputError("waves", "none", "one Wave or more")
        names = self.axes
        axes = dict.fromkeys(names, held) if isinstance(held, str) else dict(held)
        if not set(axes) <= set(names):
            raise InputError("held", sorted(axes), f"patterns for axes among {', '.join(names)}")
        axes = {axis: pattern for axis, pattern in axes.items() if pattern}
        allowed = set[int]().union(*(boundaries(self.mesh, pattern) for pattern in axes.values()))
        for wave in self.waves:
            for pattern in wave.held:
                if not boundaries(self.mesh, pattern) <= allowed:
                    raise InputError("Wave.held", repr(pattern), f"boundaries among those held: {held!r}")
            for pattern in wave.traction:
                boundaries(self.mesh, pattern)
        for wall in self.absorbing:
            boundaries(self.mesh, wall.boundary)
        if self.form.pressure is not None and self.bulk is None:
            raise InputError("bulk", None, f"a bulk modulus in Pa for the form {self.form}")
        positive(self.density, "density")
        if self.bulk is not None:
            positive(self.bulk, "bulk", complex_too=True)
        if not isinstance(self.law, OfSmallStrain) and not callable(self.law):
            raise InputError(
                "law", type(self.law).__name__, "a law of small strain such as Shearing, or a function of ω"
            )
        for wave in self.waves:
            for value in (*wave.held.values(), *wave.traction.values(), *([] if wave.force is None else [wave.force])):
                if (size := _vector(value).dim) != len(names):
                    raise InputError("Wave", f"a vector of {size} components", f"{len(names)} components")
        if names == "z" and (self.form.pressure is not None or self.bulk is not None):
            wanted = "neither with motion through the plane, which changes no volume"
            raise InputError("bulk", f"{self.bulk}, form {self.form}", wanted)
        self.form.check(self.mesh)
        return axes

    def _prescribed(self, wave: Wave) -> Array:
        values = np.zeros(self.fes.ndof, complex)
        gfu = ngs.GridFunction(self.displacement)
        for pattern, value in wave.held.items():
            region = self.mesh.Boundaries(pattern)
            gfu.Set(_vector(value), definedon=region, dual=True)  # it forgets what was set on other boundaries
            there = np.flatnonzero(np.fromiter(gfu.space.GetDofs(region), bool))
            values[there] = gfu.vec.FV().NumPy()[there]
        return np.where(self.held, values, 0)


def _amplitudes(body: Harmonic) -> list[Array]:
    """All unknowns of each wave."""
    factors = body.factorised()
    return [factors.driven(number, g) for number, g in enumerate(body.prescribed)]


def _solved(
    mesh: ngs.Mesh, law: LawOfFrequency, waves: Sequence[Wave], how: Mapping[str, Any], *, tell: parallel.Tell
) -> list[Array]:
    return _amplitudes(Harmonic(mesh, law, waves, **how))


Terms: TypeAlias = ngs.comp.SumOfIntegrals
Change: TypeAlias = Callable[[CoefficientFunction], CoefficientFunction]


def derivative(
    work: CoefficientFunction, variable: CoefficientFunction, direction: CoefficientFunction, name: str
) -> CoefficientFunction:
    """`work.Diff(variable, direction)`; `InputError` about `name` where a complex constant is in it, such as ngs.CF(2000 + 800j).

    NGSolve differentiates complex numbers and real constants, but no complex constant of its own.
    """
    try:
        return work.Diff(variable, direction)
    except Exception as error:  # NGSolve's has no name in Python
        if "Diff not implemented" not in str(error):
            raise
        wanted = "what NGSolve can differentiate: a number such as 2000 + 800j, or parts of their own, CF(2000) + 1j * CF(800)"
        raise InputError(name, "made of a complex constant, ngs.CF of a complex number", wanted) from error


def vanishes(work: CoefficientFunction) -> bool:
    """Whether differentiation has found that there is nothing."""
    return str(work).strip() == "ZeroCoefficientFunction"


def _dot(a: CoefficientFunction, b: CoefficientFunction) -> CoefficientFunction:
    """a·b without a conjugate, which InnerProduct would take."""
    if a.dim == 1:
        return a * b
    first, *rest = (a[i] * b[i] for i in range(a.dim))
    return sum(rest, first)


def _gradient(u: ngs.GridFunction) -> CoefficientFunction:
    """Of known waves, a component in each row: a gradient's form takes half the time that it takes with Grad(u)."""
    if not u.components:
        return ngs.grad(u)
    rows = tuple(ngs.grad(component) for component in u.components)
    return ngs.CF(rows, dims=(len(rows), len(rows)))


def _vector(value: Vector) -> CoefficientFunction:
    if isinstance(value, CoefficientFunction):
        return value
    if any(part is None for part in value):  # NGSolve's constructor would end the process
        raise InputError(
            "Wave", repr(tuple(value)), "numbers; components that slide are left out of `held`, {'y': 'top'}"
        )
    return ngs.CF(tuple(value))
