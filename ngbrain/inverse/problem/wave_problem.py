"""The inverse problem of wave data: the material, the wave model that predicts the data, and the unknowns."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import ngsolve as ngs
import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg
from ngsolve import CoefficientFunction
from scipy.spatial import KDTree

from ngbrain.errors import InputError
from ngbrain.forward.common.interpolation import evaluation
from ngbrain.forward.common.kinematics import AntiPlane
from ngbrain.forward.harmonic.problem import HarmonicProblem, LawOfFrequency
from ngbrain.forward.harmonic.stiffness import definite, elastic
from ngbrain.forward.harmonic.wave import Wave
from ngbrain.forward.sensitivity.harmonic.wave_model import BOUNDARY, WaveModel
from ngbrain.inverse.data.moving_least_squares import moving_least_squares
from ngbrain.inverse.data.smooth_field import SmoothField
from ngbrain.inverse.data.smoothing import fit_splines
from ngbrain.inverse.objective.parameters import ParameterFields, ScaledTransform, Transform, Unknown
from ngbrain.inverse.problem.discretisation import Discretisation, has_unknown_scale, measures_all_components
from ngbrain.inverse.problem.properties import (
    EXPONENT,
    MODULI,
    UNKNOWNS,
    Property,
    as_moduli,
    as_polar,
    material_properties,
)
from ngbrain.inverse.problem.property_fields import Composition, SingleField
from ngbrain.io.waves import WaveData
from ngbrain.materials.linear import Shearing, TransverselyIsotropic
from ngbrain.solvers.device import CPU, Device

Array = np.ndarray
GUESSED = 1e-2
"""Weight of a smooth field against the data. It defines the waves between the points."""
BETWEEN = 0.5
"""Coefficients of that smooth field for each point. With as many as `fit_smooth_field` takes, exact data are missed between
points."""
ELASTIC = 1e-6
"""Weight of elastic energy against the data. It defines the waves where elements reach out of the data or a component is
missing."""
HELD = 1e-9
"""Keeps a least-squares fit of a field definite where there are no points."""


class ElastographyProblem:
    """The inverse problem of wave data in some elements.

    Parameters
    ----------
    data : WaveData
        Waves or quasi-static displacements. Points outside the mask or the elements are left out.
    elements : Discretisation
        Their elements, see `discretise`.
    properties : tuple of Property, optional
        The unknown properties; by default those of the material.
    composition : Composition, optional
        The fields that properties are made of; by default one field each.
    device : Device
        Where matrices are factorised.

    Attributes
    ----------
    model : WaveModel
        Predicts the waves at `data.points[inside]`.
    waves : numpy.ndarray
        (loads, ndof) measured waves in the elements' unknowns, m.
    inside : numpy.ndarray
        (n,) bool, the included points.

    Raises
    ------
    InputError
        The properties are not those of the material.
    """

    def __init__(
        self,
        data: WaveData,
        elements: Discretisation,
        properties: tuple[Property, ...] | None = None,
        composition: Composition | None = None,
        device: Device = CPU,
    ) -> None:
        self.data, self.elements, self.composition = data, elements, composition or SingleField()
        self.properties = material_properties(data) if properties is None else _of_material(data, properties)
        self.inside = elements.inside & data.mask
        self.space = ngs.H1(elements.mesh, order=elements.field_order)
        self._fields = {name: self._uniform(quantity) for name, quantity in self._by_field.items()}
        self.values = as_moduli({quantity.name: self._value(quantity) for quantity in self.properties}, ngs)
        """Each property of the material as a CoefficientFunction of the fields."""
        self.bulk_factor = ngs.Parameter(1.0)
        """Factor on the bulk modulus."""
        loads = [Wave(float(f)) for f in data.frequency]
        law, bulk = self._material()
        self.body = HarmonicProblem(
            elements.mesh,
            law,
            loads,
            bulk=None if bulk is None else self.bulk_factor * bulk,
            density=data.density,
            form=elements.form,
            dirichlet=elements.driven_boundaries,
            kinematics=AntiPlane() if data.motion == "anti_plane" else None,
            quadrature=elements.quadrature,
            device=device,
            translation=data.motion == "anti_plane" and bool(np.all(data.frequency > 0)),  # at rest it moves nothing
        )
        self.model = WaveModel(self.body, self._fields, data.points[self.inside])
        self.measured = data.displacement[:, self.inside]
        self.waves = self._waves_in_elements()
        self._made_from = data, elements, self.properties, self.composition, device

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the arguments, so that other processes build the same problem."""
        return ElastographyProblem, self._made_from

    def uniform(self, unknowns: ParameterFields, level: float) -> Array:
        """Return x of uniform fields.

        Parameters
        ----------
        unknowns : ParameterFields
            The unknowns.
        level : float
            Factor on the start values of moduli.

        Returns
        -------
        numpy.ndarray
            (unknowns,)
        """
        x = unknowns.start.copy()
        for name, quantity in self._by_field.items():
            if quantity.name in MODULI:
                start, transform = self._start(replace(quantity, start=level * quantity.start))
                x[unknowns.blocks[name]] = transform.inverse(start)
        return x

    @property
    def _by_field(self) -> dict[str, Property]:
        """Name of each field → its property."""
        return {name: quantity for quantity in self.properties for name in self._parts(quantity)}

    def _parts(self, quantity: Property) -> tuple[str, ...]:
        """Names of the fields of a property. A uniform property has no parts by label."""
        if quantity.is_uniform:
            return (quantity.name,)
        return tuple(field.name for field in self.composition.fields(quantity.name))

    def unknowns(self, sigma: Array) -> ParameterFields:
        """All property fields at their start values, and the displacements of driven boundaries in units of σ (m)."""
        theta = self.model.theta
        held = self.waves[:, self.model.driven_dofs]
        theta[self.model.blocks[BOUNDARY]] = np.concatenate([part for g in held for part in (g.real, g.imag)])
        unknowns = {name: self._unknown(quantity) for name, quantity in self._by_field.items()}
        unknowns[BOUNDARY] = Unknown(theta[self.model.blocks[BOUNDARY]], ScaledTransform(float(np.median(sigma))))
        fields = ParameterFields(theta, self.model.blocks, unknowns)
        if has_unknown_scale(self.data):
            fields.undetermined_direction = self.uniform(fields, np.e) - fields.start
        return fields

    def maps(self, unknowns: ParameterFields, x: Array) -> dict[str, Array]:
        """Return maps of the material's properties.

        Parameters
        ----------
        unknowns : ParameterFields
            The unknowns.
        x : numpy.ndarray
            (unknowns,) their values.

        Returns
        -------
        dict of str to numpy.ndarray
            Property → values (n,) at all points of the data, NaN where a point is left out.
        """
        theta = unknowns.theta(x)
        at = evaluation(self.space, self.model.points)
        maps = {}
        for quantity in self.properties:
            parts = {name: at @ theta[self.model.blocks[name]] for name in self._parts(quantity)}
            found = parts[quantity.name] if quantity.is_uniform else self.composition.point_values(parts)
            maps[quantity.name] = np.full(len(self.data.points), np.nan)
            maps[quantity.name][self.inside] = found if self.elements.nodal else quantity.transform.value(found)
        return as_moduli(maps)

    def predict_from_truth(self) -> Array | None:
        """Return the waves (loads, points, dim) of the data's true properties, with measured displacements on the boundary.

        None where a property is unknown or out of the fields' bounds (such as a zero loss modulus). None also for data in
        their own elements with points left out: the nodes of these have no truth.
        """
        if self.elements.nodal and not self.inside.all():
            return None
        truths = {name: np.real(values[self.inside]) for name, values in as_polar(self.data.truth_views).items()}
        if not all(
            quantity.name in truths and quantity.contains(truths[quantity.name]) for quantity in self.properties
        ):
            return None
        unknowns = self.unknowns(np.ones(1))
        theta = unknowns.theta(unknowns.start)
        fitted = self._fit()
        for quantity in self.properties:
            truth = truths[quantity.name]
            field = truth if self.elements.nodal else fitted(quantity.transform.inverse(truth))
            for name in self._parts(quantity):
                theta[self.model.blocks[name]] = field
        return self.model.evaluate(theta).data

    def _value(self, quantity: Property) -> CoefficientFunction:
        parts = {name: self._fields[name] for name in self._parts(quantity)}
        field = parts[quantity.name] if quantity.is_uniform else self.composition.function(parts)
        # Nodal values are moduli on the grid of the data; elsewhere the field is the logarithm, positive everywhere.
        return field if self.elements.nodal else quantity.transform.function(field)

    def _unknown(self, quantity: Property) -> Unknown:
        start, transform = self._start(quantity)
        if not quantity.is_uniform:
            return Unknown(start, transform)
        ones = self._uniform(replace(quantity, start=float(quantity.transform.value(np.array(1.0))))).vec.FV().NumPy()
        if self.elements.nodal:
            ones = np.ones_like(ones)
            return Unknown(start[:1], transform, sp.csr_array(ones[:, None]))
        return Unknown(quantity.transform.inverse(np.array([quantity.start])), transform, sp.csr_array(ones[:, None]))

    def _start(self, quantity: Property) -> tuple[Array, Transform]:
        start = self._uniform(quantity).vec.FV().NumPy().copy()
        return start, quantity.transform if self.elements.nodal else ScaledTransform()

    def _uniform(self, quantity: Property) -> ngs.GridFunction:
        uniform = ngs.GridFunction(self.space)  # of higher order, not all unknowns are nodal values
        uniform.Set(
            quantity.start if self.elements.nodal else float(quantity.transform.inverse(np.array(quantity.start)))
        )
        return uniform

    def _material(self) -> tuple[LawOfFrequency, CoefficientFunction | complex | None]:
        data, value = self.data, self.values
        if data.motion == "anti_plane":
            G = data.shear_of(value["youngs"]) if "youngs" in value else value["storage"] + 1j * value["loss"]
            return self._dispersive_shear(_complex(G)), None
        if "youngs" in value:
            E = value["youngs"]
            bulk = data.bulk if data.poisson is None else E / (3 * (1 - 2 * data.poisson))
            return Shearing(_complex(data.shear_of(E))), bulk
        G = value["storage"] + 1j * value["loss"] if "storage" in value else _complex(value["mu"])
        bulk = data.bulk
        if data.poisson is not None:
            bulk = 2 * (1 + data.poisson) / (3 * (1 - 2 * data.poisson)) * G
        if data.symmetry == "isotropic":
            return self._dispersive_shear(G), bulk
        # Cached: derivatives need not differentiate it. Else it is evaluated for each pair of trial and test function.
        fibre = ngs.CacheCF(self._fibre())
        return TransverselyIsotropic(G, value["zeta"], value["phi"], fibre), bulk

    def _dispersive_shear(self, G: CoefficientFunction) -> LawOfFrequency:
        """Shear alone: G at the lowest frequency, and G (ω/ω₀)^a where an exponent a is unknown."""
        if EXPONENT not in self.values:
            return Shearing(G)
        lowest, exponent = 2 * np.pi * float(self.data.frequency.min()), self.values[EXPONENT]
        # At the lowest frequency without the factor: NGSolve takes exp(0 · a) for 0.
        return lambda omega: Shearing(
            G * ngs.exp(exponent * float(np.log(omega / lowest))) if omega > lowest * (1 + 1e-9) else G
        )

    def _fibre(self) -> CoefficientFunction:
        fibre = self.data.fibre
        assert fibre is not None  # WaveData checks it
        if np.ptp(fibre, axis=0).max() < 1e-12:
            return ngs.CF(tuple(float(a) for a in fibre[0]))
        if self.data.dim == 2:
            return self._smooth_fibre(fibre[self.inside])
        # Directions have no sign, so they are not averaged: each element takes the nearest point's direction.
        space = ngs.VectorL2(self.elements.mesh, order=0)
        field = ngs.GridFunction(space)
        centres = np.array(
            [
                np.mean([self.elements.mesh[v].point for v in el.vertices], axis=0)
                for el in self.elements.mesh.Elements()
            ]
        )
        nearest = KDTree(self.data.points[self.inside]).query(centres)[1]
        field.vec.FV().NumPy()[:] = fibre[self.inside][nearest].T.ravel()
        return field / ngs.Norm(field)

    def _smooth_fibre(self, fibre: Array) -> CoefficientFunction:
        """Fibre directions in the plane, from a least-squares fit of twice their angle.

        Twice the angle has no sign ambiguity. Piecewise constant directions would count as noise.
        """
        twice = 2 * np.arctan2(fibre[:, 1], fibre[:, 0])
        fitted = self._fit()
        parts = []
        for values in (np.cos(twice), np.sin(twice)):
            part = ngs.GridFunction(self.space)
            part.vec.FV().NumPy()[:] = fitted(values)
            parts.append(part)
        angle = 0.5 * ngs.atan2(parts[1], parts[0])
        return ngs.CF((ngs.cos(angle), ngs.sin(angle)))

    def _fit(self) -> Callable[[Array], Array]:
        """Return a function from values at the included points to a least-squares field."""
        at = evaluation(self.space, self.data.points[self.inside])
        normal = scipy.sparse.linalg.splu(sp.csc_array(at.T @ at + HELD * sp.eye_array(self.space.ndof)))
        return lambda values: normal.solve(at.T @ values)

    def _waves_in_elements(self) -> Array:
        """Measured waves in the elements' unknowns: nodal values on the data's own grid, else fitted with a smooth field."""
        complete = not np.isnan(self.measured).any()
        ndof, space = self.body.fes.ndof, ngs.H1(self.elements.mesh, order=self.body.form.order)
        waves = np.zeros((self.data.loads, ndof), complex)
        if self.elements.nodal and complete:
            for k, values in enumerate(self.measured):
                waves[k, : values.size] = values.T.ravel()
            return waves
        every = measures_all_components(self.data)
        if self.data.dim == 3 and np.isfinite(self.measured).any(axis=1).sum(axis=1).min() < 2:
            wanted = "two of them at least for each load in space: one alone does not determine the waves"
            raise InputError("displacement", "of which one component alone is measured", wanted)
        beyond = self.data.grid is not None and not self.data.mask.all()  # elements reach out of a mask
        if self.data.dim == 3 or not every or beyond:
            return self._fit_with_elastic_energy()
        at = _samples(self.elements.mesh, self.body.form.order)
        guess = np.nan_to_num(_smooth(self.data).values(at))
        there, here = evaluation(space, at), evaluation(space, self.model.points)
        share = GUESSED * len(self.model.points) / len(at)
        for k, load in enumerate(self.measured):
            for i, values in enumerate(load.T):
                known = ~np.isnan(values)
                seen = here[known]
                solve = scipy.sparse.linalg.splu(sp.csc_array(seen.T @ seen + share * (there.T @ there))).solve
                b = seen.T @ values[known] + share * (there.T @ guess[k, :, i])
                waves[k, i * space.ndof : (i + 1) * space.ndof] = solve(b.real) + 1j * solve(b.imag)
        return waves

    def _fit_with_elastic_energy(self) -> Array:
        """Fit the measured waves by least squares, regularised by elastic energy.

        The energy defines the waves where elements reach out of the data or a component is missing.
        """
        body, order = self.body, self.body.form.order
        observe = evaluation(ngs.H1(self.elements.mesh, order=order), self.model.points)
        ground = HELD * observe.shape[0] / observe.shape[1] * sp.eye_array(len(self.data.components) * observe.shape[1])
        waves = np.zeros((self.data.loads, body.fes.ndof), complex)
        known, case = ~np.isnan(self.measured), (np.nan, b"")
        for k, (wave, here) in enumerate(zip(body.waves, known, strict=True)):
            seen = [observe[each] for each in here.T]
            before, case = case, (wave.omega, here.tobytes())
            if case != before:  # else the last factorisation is used again
                squares = sp.block_diag([each.T @ each for each in seen])
                solve = definite(sp.coo_array(squares + ELASTIC * len(here) * elastic(body, k, order) + ground))
            values = [part[each] for part, each in zip(self.measured[k].T, here.T, strict=True)]
            b = np.concatenate([each.T @ part for each, part in zip(seen, values, strict=True)])
            waves[k, : len(b)] = solve(b.real) + 1j * solve(b.imag)
        return waves


def _of_material(data: WaveData, properties: tuple[Property, ...]) -> tuple[Property, ...]:
    names = [quantity.name for quantity in properties if quantity.name != EXPONENT]
    kinds = [UNKNOWNS[kind](data, 1.0) for kind in (UNKNOWNS if data.rheology == "viscoelastic" else ("moduli",))]
    known = [[quantity.name for quantity in each] for each in kinds]
    wanted = ", or ".join(", ".join(each) for each in known)
    if "bulk" in names:
        wanted = f"{wanted}: the bulk modulus is given, because shear waves hardly depend on it"
        raise InputError("properties", "bulk", wanted)
    if names not in known:
        raise InputError("properties", ", ".join(names), wanted)
    return properties


def _smooth(data: WaveData) -> SmoothField:
    try:
        return fit_splines(data, BETWEEN)
    except InputError:  # scattered points, or a grid of too few for splines
        return moving_least_squares(data)


def _complex(value: CoefficientFunction) -> CoefficientFunction:
    return value * (1 + 0j)


def _samples(mesh: ngs.Mesh, order: int) -> Array:
    """Points in all elements, about (order + 1)² of each: enough for a polynomial of the order, all of them inside."""
    rule: Callable[[ngs.ET], ngs.IntegrationRule] = lambda shape: ngs.IntegrationRule(shape, 2 * order + 1)  # noqa: E731
    rules: Mapping[ngs.ET, ngs.IntegrationRule] = {shape: rule(shape) for shape in {el.type for el in mesh.Elements()}}
    mapped = mesh.MapToAllElements(rules, ngs.VOL)
    position = ngs.CF((ngs.x, ngs.y, ngs.z)[: mesh.dim])
    return np.asarray(position(mapped))
