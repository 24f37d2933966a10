"""Material of a region."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import ngsolve as ngs
import numpy as np
from ngsolve import CoefficientFunction
from ngsolve.comp import IntegrationRuleSpace

from ngbrain.errors import InputError
from ngbrain.look import BriefText, NotebookCard
from ngbrain.materials import Law, Viscous, barrier, quadratic
from ngbrain.materials.base import Deformation, Value, check_parameter, density
from ngbrain.materials.points import initial_modulus
from ngbrain.materials.viscous import viscous
from ngbrain.materials.volumetric import mixed_form

Change = Callable[[CoefficientFunction, Value], CoefficientFunction]


@dataclass(frozen=True, repr=False)
class Material(BriefText, NotebookCard):
    """Material of a region: isochoric law, volumetric energy, and an optional barrier against collapse.

    Parameters
    ----------
    law : Law or Viscous
        W, an isochoric law, elastic or viscoelastic.
    bulk : float, Parameter or CoefficientFunction
        Bulk modulus K (Pa); inf: incompressible, with mixed elements only.
    pointwise : float
        κ (Pa) of a `barrier` that prevents collapse of J at single points, where a pressure controls it only in the mean over an
        element. Needed at re-entrant corners, such as those of a cut; not in smooth bodies.
    change : callable
        Volumetric energy U(J) of bulk modulus K, `quadratic` or `squared_log`; with a pressure, its mixed form.
    swelling : float, Parameter or CoefficientFunction
        Relative change s of the stress-free volume at load factor 1, more than -1. It grows with the load factor t:
        F = F_e F_g with F_g = (1 + t s)^(1/3) Id, and the energy per volume at rest is (1 + t s) W(F_e).

    References
    ----------
    Rodriguez, Hoger, McCulloch 1994, https://doi.org/10.1016/0021-9290(94)90021-3 (multiplicative growth).

    Examples
    --------
    >>> from ngbrain.materials import NeoHooke, Prony
    >>> Material(Prony(NeoHooke(1e3), [0.5], [10.0]), bulk=1e6).viscous.branches[0].tau
    10.0
    """

    law: Viscous | Law
    bulk: Value
    pointwise: Value = 0.0
    change: Change = field(default=quadratic, repr=False)
    swelling: Value = 0.0

    def __post_init__(self) -> None:
        if not any(hasattr(self.law, name) for name in ("energy", "density", "branches")):
            raise InputError("Material.law", repr(self.law), "an object with `energy(C)`, W in Pa of a 3×3 tensor C")
        if not self.bulk_is_infinite:
            check_parameter(self.bulk, "Material.bulk", lambda k: k >= 0, "a number of at least 0")
        check_parameter(self.pointwise, "Material.pointwise", lambda kappa: kappa >= 0, "a number of at least 0")
        check_parameter(self.swelling, "Material.swelling", lambda s: s > -1, "a relative change of volume above -1")

    def summary(self) -> dict[str, str]:
        """Law, parameters, shear and bulk modulus in words."""
        from ngbrain.materials.lab.description import law_rows  # the laboratory imports SciPy's optimisers

        bulk = (
            "infinite"
            if self.bulk_is_infinite
            else f"{self.bulk:.4g} Pa"
            if isinstance(self.bulk, float)
            else "a field"
        )
        return law_rows(self.law) | {"bulk modulus": bulk}

    def plot(self) -> Any:
        """Stress of the isochoric law against stretch, see `ngbrain.materials.lab.plot_law`."""
        from ngbrain.materials.lab.plot import plot_law

        return plot_law(self.law)

    @property
    def bulk_is_infinite(self) -> bool:
        """Whether it is incompressible."""
        return isinstance(self.bulk, float) and self.bulk == np.inf

    @property
    def viscous(self) -> Viscous:
        """Isochoric law as a `Viscous`, without branches if it is elastic."""
        return viscous(self.law)

    @property
    def elastic(self) -> Law:
        """Elastic isochoric law; `InputError` for a viscoelastic one."""
        if isinstance(self.law, Viscous) and self.law.branches:
            raise InputError("material", "a viscoelastic law", "an elastic one, such as its `equilibrium`")
        return self.viscous.equilibrium

    def energy(self, at: Deformation, p: CoefficientFunction | None, factor: Value = 1.0) -> CoefficientFunction:
        """Strain energy density (Pa) of an elastic material, per volume at rest.

        Parameters
        ----------
        at : Deformation
        p : CoefficientFunction, optional
            Pressure (Pa) of mixed elements.
        factor : float or Parameter
            Load factor, to which the swelling is proportional.

        Returns
        -------
        CoefficientFunction
        """
        at, volume = self.elastic_part(at, factor)
        return volume * (density(self.elastic, at) + self.volumetric_energy(at.J, p))

    def elastic_part(self, at: Deformation, factor: Value = 1.0) -> tuple[Deformation, Value]:
        """Elastic part F_e of a deformation, and the stress-free volume per volume at rest.

        The swelling is the same in all directions, so that the isochoric part of the deformation is all elastic.

        Parameters
        ----------
        at : Deformation
        factor : float or Parameter
            Load factor, to which the swelling is proportional.

        Returns
        -------
        elastic : Deformation
        volume : float or CoefficientFunction
            1 + t s.

        Examples
        --------
        >>> import ngsolve as ngs
        >>> from ngbrain.materials import NeoHooke
        >>> swollen = Material(NeoHooke(1e3), 1e5, swelling=0.331)
        >>> elastic, volume = swollen.elastic_part(Deformation.from_gradient(1.1 * ngs.Id(3)))
        >>> volume
        1.331
        """
        if not self.swells:
            return at, 1.0
        volume = 1 + factor * self.swelling
        gradient = None if at.gradient is None else at.gradient * volume ** (-1 / 3)
        return Deformation(at.shape, at.C * volume ** (-2 / 3), at.J / volume, gradient), volume

    @property
    def swells(self) -> bool:
        """Whether its stress-free volume changes."""
        return isinstance(self.swelling, CoefficientFunction) or self.swelling != 0

    def volumetric_energy(self, J: CoefficientFunction, p: CoefficientFunction | None) -> CoefficientFunction:
        """Volumetric part of the energy density (Pa).

        Parameters
        ----------
        J : CoefficientFunction
            det F.
        p : CoefficientFunction, optional
            Pressure (Pa) of mixed elements.

        Returns
        -------
        CoefficientFunction
        """
        energy = self.change(J, self.bulk) if p is None else mixed_form(self.change)(J, p, self.bulk)
        return energy + barrier(J, self.pointwise) if self.pointwise else energy


def stiffness(
    mesh: ngs.Mesh, materials: Mapping[str, Material], points: int | None = None
) -> tuple[CoefficientFunction, float, float]:
    """Initial shear modulus over a mesh, its largest value and the largest K/μ, from means over elements.

    Parameters
    ----------
    mesh : ngsolve.Mesh
    materials : dict
        Region pattern → `Material`.
    points : int, optional
        Half the order of the quadrature at whose points the fields of the materials are defined; None: everywhere.

    Returns
    -------
    moduli : CoefficientFunction
        μ (Pa).
    largest : float
        Largest μ (Pa).
    ratio : float
        Largest K/μ.

    Raises
    ------
    InputError
        For a shear modulus that is not positive.
    """
    moduli = {name: initial_modulus(m.elastic) for name, m in materials.items()}
    rules = None if points is None else IntegrationRuleSpace(mesh, order=points).GetIntegrationRules()
    stiffest = {name: _largest(mesh, name, mu, rules) for name, mu in moduli.items()}
    for name, found in stiffest.items():
        if not found > 0:
            raise InputError(
                f"materials[{name!r}].law", f"of a shear modulus at rest of {found:g} Pa", "a positive one"
            )
    largest = max(stiffest.values())
    ratio = max(
        float(m.bulk) / moduli[name]
        if not isinstance(m.bulk, CoefficientFunction) and not isinstance(moduli[name], CoefficientFunction)
        else _largest(mesh, name, m.bulk / moduli[name], rules)
        for name, m in materials.items()
    )
    return mesh.MaterialCF(moduli), largest, ratio


def _largest(mesh: ngs.Mesh, pattern: str, value: Value, rules: Any) -> float:
    """Largest mean over an element."""
    if not isinstance(value, CoefficientFunction):
        return float(value)
    inside = ngs.dx(definedon=mesh.Materials(pattern), **({} if rules is None else {"intrules": rules}))
    parts = (ngs.Integrate(v * inside, mesh, element_wise=True).NumPy() for v in (value, ngs.CF(1)))
    amount, size = (np.array(part) for part in parts)
    return float(np.max(amount[size > 0] / size[size > 0]))
