"""Time-harmonic waves of small amplitude, u(x, t) = Re(u(x) e^{iωt}), in elastic and viscoelastic bodies.

Find u with u = g on Dirichlet boundaries and, for all v that are zero there,

    ∫ ∂W/∂ε(ε(u)) : ε(v) - ω² ρ u·v  +  iω ∫_absorbing (z_p (u·n)(v·n) + z_s u_t·v_t)  =  ∫ f·v + ∫ t·v

W is a quadratic energy with complex moduli, written without conjugates: the matrix is complex-symmetric, so that its factorisation
serves the adjoint too. In anti-plane motion (`AntiPlane`) u is a scalar and ∂W/∂ε:ε(v) = G ∇u·∇v. Nearly incompressible bodies
have the pressure p as an additional unknown, W = W_iso(ε) + p tr ε - p²/2K. ω = 0 is the quasi-static case.

About the equilibrium of a deformed body (`HarmonicProblem.about`) the matrix contains the body's tangent, see `about_state`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import ngsolve as ngs
import numpy as np
from ngsolve import CoefficientFunction
from ngsolve.comp import IntegrationRuleSpace

from ngbrain import parallel
from ngbrain.errors import InputError
from ngbrain.forward.common.elements import ElementPair
from ngbrain.forward.common.kinematics import AntiPlane, PlaneStrain, SolidKinematics, kinematics_of
from ngbrain.forward.common.regions import boundaries
from ngbrain.forward.common.solve_counts import Solves
from ngbrain.forward.harmonic.factors import Factorised
from ngbrain.forward.harmonic.integrands import Change, Terms, derivative, dot, gradient, same, vanishes
from ngbrain.forward.harmonic.wave import AbsorbingBoundary, Wave, dirichlet_axes, vector
from ngbrain.materials.base import Value, check_positive
from ngbrain.materials.linear import SmallStrainLaw
from ngbrain.solvers.device import CPU, Device

if TYPE_CHECKING:
    from ngbrain.forward.harmonic.about_state import AboutState
    from ngbrain.forward.solid.problem import Problem

Array = np.ndarray
LawOfFrequency: TypeAlias = SmallStrainLaw | Callable[[float], SmallStrainLaw]
"""A law of ε with complex moduli, or a function that gives it for ω (rad/s)."""


class HarmonicProblem:
    """Harmonic problem of a body: at rest, or by `HarmonicProblem.about` about the equilibrium of a deformed body.

    Parameters
    ----------
    mesh : ngsolve.Mesh
        2-D (plane strain, or `kinematics` of `Axisymmetric()` or `AntiPlane()`) or 3-D.
    law : law of small strain, or function
        Complex moduli allowed; with `bulk` a deviatoric law (`Shearing`, `TransverselyIsotropic`). A function
        of ω (rad/s) gives a law for each frequency.
    waves : sequence of Wave
        The loads; those of one frequency share a factorisation.
    bulk : float, complex or CoefficientFunction, optional
        Bulk modulus K (Pa); None if the law contains the volumetric part.
    density : float or CoefficientFunction
        ρ (kg/m³).
    form : str
        "P4" or, with the pressure as an unknown, "P4/P3", "P4/L2(2)"; on quadrilaterals "Q1", "Q1/L2(0)" too.
    dirichlet : str or dict
        Dirichlet boundaries, on which each wave prescribes the displacement (0 by default): a pattern, or patterns for single
        components, {"x": "side|top", "y": "top"}.
    absorbing : sequence of AbsorbingBoundary
        Absorbing boundaries.
    kinematics : SolidKinematics, optional
        Of a plane mesh: `PlaneStrain()` (default), `Axisymmetric()`, `AntiPlane()`.
    quadrature : int, optional
        Half the degree of the quadrature on elements; by default the order plus one.
    device : Device
        Device that factorises matrices; `Device.from_name("cuda")` for a GPU.
    translation : bool
        In anti-plane motion: whether each wave has an additional rigid translation (m) of the body, the last unknown, prescribed
        as 0. Measurements do not contain it where the head's motion was subtracted, or where a phase image is known only up to
        multiples of 2π. A pressure gradient along z has the same effect.

    Raises
    ------
    InputError
        For patterns that match nothing, unstable element pairs, a pressure without K, a negative density, and a complex
        constant of NGSolve as a modulus, ngs.CF(2000 + 800j); use a number, or CF(2000) + 1j * CF(800).

    Examples
    --------
    >>> from ngbrain.materials import Shearing
    >>> from ngbrain.mesh.geometry.structured import rectangles
    >>> mesh = rectangles(np.linspace(0, 0.1, 9), np.linspace(0, 0.1, 9))
    >>> body = HarmonicProblem(mesh, Shearing(2000 + 800j), [Wave(50.0, {"top": (1e-3, 0)})], bulk=2e5, dirichlet="top|bottom")
    >>> u, = body.solve()
    >>> u(mesh(0.05, 0.1))[0]
    (0.001+0j)
    """

    law: LawOfFrequency
    state: AboutState | None = None
    """Waves about the equilibrium of a deformed body; None at rest."""
    bulk: Value | None = None
    absorbing: tuple[AbsorbingBoundary, ...] = ()
    translation = False

    def __init__(
        self,
        mesh: ngs.Mesh,
        law: LawOfFrequency,
        waves: Sequence[Wave],
        *,
        bulk: Value | None = None,
        density: Value = 1000.0,
        form: str = "P4",
        dirichlet: str | Mapping[str, str] = ".*",
        absorbing: Sequence[AbsorbingBoundary] = (),
        kinematics: SolidKinematics | None = None,
        quadrature: int | None = None,
        device: Device = CPU,
        translation: bool = False,
    ) -> None:
        self._settings = {
            "bulk": bulk, "density": density, "form": form, "dirichlet": dirichlet, "absorbing": absorbing,
            "kinematics": kinematics, "quadrature": quadrature, "device": device, "translation": translation,
        }  # fmt: skip
        self.law, self.bulk, self.absorbing, self.translation = law, bulk, tuple(absorbing), translation
        self._initialise(mesh, waves, density, ElementPair.named(form), kinematics_of(mesh, kinematics))
        self._check_medium()
        axes = dirichlet_axes(mesh, self.axes, self.waves, dirichlet)
        if self.axes == "z":
            self.displacement = ngs.H1(mesh, order=self.form.order, complex=True, dirichlet=axes.get("z", ""))
        else:
            self.displacement = ngs.VectorH1(mesh, order=self.form.order, complex=True, **_dirichlet(axes))
        self.fes = self.displacement
        if translation:
            self.fes = self.displacement * ngs.NumberSpace(mesh, complex=True)
        elif self.form.pressure is not None:
            pressures = ngs.H1 if self.form.continuous else ngs.L2
            self.fes = self.displacement * pressures(mesh, order=self.form.pressure, complex=True)
        self._discretise(device, quadrature)
        for omega in {wave.omega for wave in self.waves}:
            self.weak_form_terms(omega, *self.fes.TnT())  # raises an error for a law that cannot be differentiated

    @classmethod
    def about(
        cls,
        body: Problem,
        waves: Sequence[Wave],
        *,
        loss: Value = 0.0,
        density: Value = 1000.0,
        dirichlet: str | Mapping[str, str] | None = None,
        device: Device = CPU,
    ) -> HarmonicProblem:
        """Small waves about the body's equilibrium at the time of the solve (acoustoelasticity).

        Coordinates, points, densities and tractions refer to the reference configuration; the contact zone is frozen. A loss
        factor that depends on frequency needs one problem per frequency.

        Parameters
        ----------
        body : Problem
            Elastic, under its supports, loads and contacts without friction; `LoadPath` brings it to equilibrium.
        waves : sequence of Wave
            Excitations; dead loads, as follower loads are part of the body's tangent.
        loss : float or CoefficientFunction
            Loss factor η: shear moduli are (1 + iη) times those of the body's laws.
        density : float or CoefficientFunction
            ρ (kg/m³).
        dirichlet : str or dict, optional
            Dirichlet boundaries of the waves, as above; by default those of the body.
        device : Device
            Device that factorises matrices; follower pressures make them nonsymmetric, which needs the CPU.

        Raises
        ------
        InputError
            For a viscoelastic body, and one with friction or self-contact.

        References
        ----------
        Ogden 2007, 10.1007/978-3-211-73572-5_1.

        Examples
        --------
        >>> from ngbrain.forward import LoadPath, Material, Problem, Wave
        >>> from ngbrain.materials import NeoHooke
        >>> from ngbrain.mesh.geometry.structured import rectangles
        >>> mesh = rectangles(np.linspace(0, 0.1, 4), np.linspace(0, 0.1, 4))
        >>> body = Problem(mesh, {".*": Material(NeoHooke(2e3), 1e5)}, {"bottom": 0, "top": (0, -0.02)}, element="Q2/Q1")
        >>> record = LoadPath(body).solve()
        >>> u, = HarmonicProblem.about(body, [Wave(30.0, {"top": (1e-3, 0)})], loss=0.2).solve()
        >>> u.components[0](mesh(0.05, 0.1))[0]
        (0.001+0j)
        """
        from ngbrain.forward.harmonic.about_state import AboutState  # not needed for a body at rest

        made = cls.__new__(cls)
        made.state = AboutState(body, loss, density)
        made._initialise(body.mesh, waves, made.state.density, body.element, body.kinematics)
        axes = dirichlet_axes(
            body.mesh, made.axes, made.waves, made.state.supports() if dirichlet is None else dirichlet
        )
        made.displacement = ngs.VectorH1(body.mesh, order=body.element.order, complex=True, **_dirichlet(axes))
        made.fes = made.state.space(made.displacement)
        made._discretise(device if body.symmetric else made.state.pivoting_device(device), None)
        return made

    def _initialise(
        self, mesh: ngs.Mesh, waves: Sequence[Wave], density: Value, form: ElementPair, kinematics: SolidKinematics
    ) -> None:
        self.mesh, self.waves, self.density = mesh, tuple(waves), density
        self.form, self.kinematics = form, kinematics
        self.axes = "z" if isinstance(kinematics, AntiPlane) else "xyz"[: mesh.dim]
        """Components of the displacement."""

    def _discretise(self, device: Device, quadrature: int | None) -> None:
        """Set the constrained unknowns, the quadrature, and the prescribed displacements of the waves."""
        self.device, self.device_note = device.for_unknowns(self.fes.ndof)
        self.fixed = ~np.fromiter(self.fes.FreeDofs(), bool, self.fes.ndof)
        self.fixed[self.displacement.ndof :] |= self.translation
        self.free = ngs.BitArray((~self.fixed).tolist())
        degree = self.form.order + 1 if quadrature is None else quadrature
        self.rules = IntegrationRuleSpace(self.mesh, order=degree).GetIntegrationRules()
        self.boundary_rules = {
            shape: ngs.IntegrationRule(shape, 2 * degree) for shape in (ngs.SEGM, ngs.TRIG, ngs.QUAD)
        }
        self.prescribed = [self._prescribed(wave) for wave in self.waves]
        """Prescribed displacement amplitudes (m), one array for each wave; zero at free unknowns."""

    @property
    def symmetric(self) -> bool:
        """Whether the matrices are symmetric: all but those about a body under a follower pressure."""
        return self.state is None or self.state.body.symmetric

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
        if self.fes is not self.displacement:
            u, p, *_ = whole.components if known else whole
        return u, p if self.mixed else None, gradient(u) if known else ngs.Grad(u)

    def strain(self, u: CoefficientFunction, grad: CoefficientFunction) -> CoefficientFunction:
        """Small strain ε(u).

        Parameters
        ----------
        u, grad : CoefficientFunction
            Displacement (m) and its gradient.

        Returns
        -------
        CoefficientFunction
            2×2 in plane strain, else 3×3.
        """
        if isinstance(self.kinematics, PlaneStrain):
            return ngs.Sym(grad)
        return ngs.Sym(self.kinematics.gradient(u, grad)) - ngs.Id(3)

    def weak_form_terms(
        self, omega: float, trial: CoefficientFunction, test: CoefficientFunction
    ) -> list[CoefficientFunction]:
        """Volume integrands, bilinear in `trial` and `test`, by differentiation of the energy.

        They are not summed: NGSolve evaluates an integrand for each pair of entries of all gradients and values in it. In 3-D,
        where multiplication costs more than evaluation, integrands of the same gradients are merged: third-order hexahedra then
        take 0.35 s instead of 0.56 s.

        Parameters
        ----------
        omega : float
            Angular frequency (rad/s).
        trial, test : CoefficientFunction

        Returns
        -------
        list of CoefficientFunction
        """
        (u, p, grad_u), (v, q, grad_v) = self.split(trial), self.split(test)
        strain, along = self.strain(u, grad_u).MakeVariable(), self.strain(v, grad_v)
        law = self.law if isinstance(self.law, SmallStrainLaw) else self.law(omega)
        weak_form_terms = [derivative(law.energy(strain), strain, along, "law")]
        if p is not None and self.bulk is not None:
            pressure = p.MakeVariable()
            pressing, pressed = pressure * ngs.Trace(strain), -1 / (2 * self.bulk) * pressure * pressure
            weak_form_terms.append(pressing.Diff(strain, along) + pressing.Diff(pressure, q))
            weak_form_terms.append(derivative(pressed, pressure, q, "bulk"))
        elif self.bulk is not None:
            pressed = derivative(self.bulk / 2 * ngs.Trace(strain) * ngs.Trace(strain), strain, along, "bulk")
            weak_form_terms = [weak_form_terms[0] + pressed] if self.mesh.dim == 3 else [*weak_form_terms, pressed]
        if self.translation:
            u, v = (sum(each.components if isinstance(each, ngs.GridFunction) else each) for each in (trial, test))
        if omega:
            weak_form_terms.append(-(omega**2) * self.inertia(u, v))
        return [self.kinematics.weight() * work for work in weak_form_terms]

    def inertia(self, u: CoefficientFunction, v: CoefficientFunction) -> CoefficientFunction:
        """Inertia integrand ρ u·v.

        Parameters
        ----------
        u, v : CoefficientFunction
            Displacements.

        Returns
        -------
        CoefficientFunction
        """
        return self.density * dot(u, v)

    def terms(
        self, omega: float, trial: CoefficientFunction, test: CoefficientFunction, change: Change
    ) -> Terms | None:
        """All integrals of the bilinear form.

        Parameters
        ----------
        omega : float
            Angular frequency (rad/s).
        trial, test : CoefficientFunction
        change : callable
            Applied to each integrand, such as a derivative.

        Returns
        -------
        SumOfIntegrals or None
            None if all vanish.
        """
        changed = map(change, self.weak_form_terms(omega, trial, test))
        integrals = [work * ngs.dx(intrules=self.rules) for work in changed if not vanishes(work)]
        u, v = self.split(trial)[0], self.split(test)[0]
        for wall in self.absorbing if omega else ():
            normal = ngs.specialcf.normal(self.mesh.dim)
            u_n, v_n = (ngs.CF(0.0),) * 2 if self.axes == "z" else (dot(u, normal), dot(v, normal))
            squeezed = ngs.sqrt(self.density * (wall.bulk + 4 / 3 * wall.shear) * ngs.CF(1))
            sheared = ngs.sqrt(self.density * wall.shear * ngs.CF(1))
            work = 1j * omega * self.kinematics.weight() * (squeezed * u_n * v_n + sheared * (dot(u, v) - u_n * v_n))
            if not vanishes(work := change(work)):
                integrals.append(work * ngs.ds(wall.boundary, intrules=self.boundary_rules))
        return sum(integrals[1:], integrals[0]) if integrals else None

    def matrices(self) -> Callable[[float], ngs.BaseMatrix]:
        """Function from ω (rad/s) to the matrix for all unknowns, at the current moduli."""
        if self.state is not None:
            return self.state.matrices(self.fes)
        trial, test = self.fes.TnT()

        def assembled(omega: float) -> ngs.BaseMatrix:
            form = ngs.BilinearForm(self.fes)
            form += self.terms(omega, trial, test, same)
            return form.Assemble().mat

        return assembled

    def factorise(self, solves: Solves | None = None) -> Factorised:
        """Matrices at the current moduli (and equilibrium), with factorisations counted in `solves`."""
        return Factorised(self, solves)

    def solve(self, executor: parallel.AnyExecutor = None) -> list[ngs.GridFunction]:
        """Complex amplitudes (m) of each wave; in mixed form the first component is the displacement.

        Parameters
        ----------
        executor : int or concurrent.futures.Executor, optional
            Solves the waves of each frequency on one thread (`parallel.run`), each on a rebuilt body of the same mesh and moduli;
            by default, and always about a deformed body, this process. The result does not depend on it.

        Raises
        ------
        SolverError
            Where a matrix has no usable factorisation, as at a resonance without loss.
        """
        of = {wave.frequency: [w for w in self.waves if w.frequency == wave.frequency] for wave in self.waves}
        if executor in (None, 1) or len(of) < 2 or self.state is not None:
            amplitudes = _amplitudes(self)
        else:
            tasks = [
                parallel.Task(f"{frequency:g} Hz", _solved, (self.mesh, self.law, waves, self._settings))
                for frequency, waves in of.items()
            ]
            each = dict(zip(of, map(iter, parallel.run(tasks, executor).values()), strict=True))
            amplitudes = [next(each[wave.frequency]) for wave in self.waves]
        found = []
        for values in amplitudes:
            found.append(ngs.GridFunction(self.fes))
            found[-1].vec.FV().NumPy()[:] = values
        return found

    def load_vector(self, number: int) -> Array:
        """Load vector ∫ f·v + ∫ t·v of a wave."""
        wave, test = self.waves[number], self.split(self.fes.TestFunction())[0]
        if wave.force is None and not wave.traction:
            return np.zeros(self.fes.ndof, complex)
        load = ngs.LinearForm(self.fes)
        if wave.force is not None:
            load += self.kinematics.weight() * dot(vector(wave.force), test) * ngs.dx(intrules=self.rules)
        for boundary, traction in wave.traction.items():
            work = self.kinematics.weight() * dot(vector(traction), test)
            load += work * ngs.ds(boundary, intrules=self.boundary_rules)
        load.Assemble()
        return load.vec.FV().NumPy().copy()

    def _check_medium(self) -> None:
        if self.translation and self.axes != "z":
            raise InputError("translation", True, "False, except in anti-plane motion")
        for wall in self.absorbing:
            boundaries(self.mesh, wall.boundary)
        if self.form.pressure is not None and self.bulk is None:
            raise InputError("bulk", None, f"a bulk modulus in Pa for the form {self.form}")
        check_positive(self.density, "density")
        if self.bulk is not None:
            check_positive(self.bulk, "bulk", complex_too=True)
        if not isinstance(self.law, SmallStrainLaw) and not callable(self.law):
            raise InputError(
                "law", type(self.law).__name__, "a law of small strain such as Shearing, or a function of ω"
            )
        if self.axes == "z" and (self.form.pressure is not None or self.bulk is not None):
            wanted = "neither in anti-plane motion, which is isochoric"
            raise InputError("bulk", f"{self.bulk}, form {self.form}", wanted)
        self.form.check(self.mesh)

    def _prescribed(self, wave: Wave) -> Array:
        values = np.zeros(self.fes.ndof, complex)
        gfu = ngs.GridFunction(self.displacement)
        for pattern, value in wave.displacement.items():
            region = self.mesh.Boundaries(pattern)
            gfu.Set(vector(value), definedon=region, dual=True)  # resets the values on other boundaries
            there = np.flatnonzero(np.fromiter(gfu.space.GetDofs(region), bool))
            values[there] = gfu.vec.FV().NumPy()[there]
            if np.any(values[there][~self.fixed[there]]):
                wanted = "0 for components that are free there"
                raise InputError("Wave.displacement", f"{pattern!r} with a displacement of a free component", wanted)
        return values


def _dirichlet(axes: Mapping[str, str]) -> dict[str, str]:
    return {f"dirichlet{axis}": pattern for axis, pattern in axes.items()}


def _amplitudes(body: HarmonicProblem) -> list[Array]:
    """All unknowns of each wave."""
    factors = body.factorise()
    return [factors.solve_wave(number, g) for number, g in enumerate(body.prescribed)]


def _solved(
    mesh: ngs.Mesh, law: LawOfFrequency, waves: Sequence[Wave], how: Mapping[str, Any], *, callback: parallel.Callback
) -> list[Array]:
    return _amplitudes(HarmonicProblem(mesh, law, waves, **how))
