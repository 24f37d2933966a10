"""Laws by family: one with its moduli times a factor, several as one where they have the same form, or each where it occurs.

A family is a class of laws whose energies differ in constants alone: Neo-Hooke and Ogden (Neo-Hooke is Ogden with α = 2), and each
other law with itself. Tissues of one family cost what one of them does, as their constants may be fields.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, TypeVar, cast

import ngsolve as ngs
import numpy as np
from ngsolve import CoefficientFunction

from ngbrain.errors import InputError
from ngbrain.materials.base import Composite, Deformation, Law, Scaled, Sum, Value, density, density_of_log_strains
from ngbrain.materials.fibre import Fung, Guccione, HolzapfelGasserOgden
from ngbrain.materials.flow import Maxwell
from ngbrain.materials.isotropic import Demiray, Gent, MooneyRivlin, NeoHooke, Ogden, Polynomial, UnsplitNeoHooke
from ngbrain.materials.points import initial_modulus
from ngbrain.materials.viscous import Branch, Viscous, step_factors, viscous

MODULI: dict[type, tuple[str, ...]] = {
    NeoHooke: ("mu",),
    UnsplitNeoHooke: ("mu",),
    MooneyRivlin: ("c10", "c01"),
    Polynomial: ("c",),
    Gent: ("mu",),
    Demiray: ("mu",),
    Ogden: ("mu",),
    HolzapfelGasserOgden: ("mu", "k1"),
    Fung: ("c",),
    Guccione: ("c",),
}
"""The fields of a law that its energy is proportional to."""
FAMILIES = (NeoHooke, Ogden, Polynomial, Gent, Demiray)
"""Laws whose constants may be fields all alike."""
NEO_HOOKE = 2.0
"""The exponent with which Ogden's law is Neo-Hooke's."""
T = TypeVar("T")
Pair = tuple[Law | None, Value]
"""A tissue's law, None where it has none, and the tissue's share."""


@dataclass(frozen=True)
class Piecewise(Composite):
    """Several laws, each where its share is more than a half; elsewhere it is not heard, even where it has no energy.

    parts   (law, share) each; the share is 1 where the law holds and 0 elsewhere, at every quadrature point

    >>> import ngsolve as ngs
    >>> left = ngs.IfPos(ngs.x, 0.0, 1.0)
    >>> Piecewise(((NeoHooke(1e3), left), (Gent(2e3, 0.1), 1 - left))).energy(ngs.Id(3)).dim
    1
    """

    parts: tuple[tuple[Law, Value], ...]

    def density(self, at: Deformation) -> CoefficientFunction:
        """Energy density (Pa)."""
        first, *rest = (ngs.IfPos(share - 0.5, density(law, at), 0.0) for law, share in self.parts)
        return sum(rest, first)

    def log_strain_energy(self, logs: Sequence[CoefficientFunction]) -> CoefficientFunction:
        """The same (Pa) at logarithmic strains, see `density_of_log_strains`."""
        first, *rest = (ngs.IfPos(share - 0.5, density_of_log_strains(law, logs), 0.0) for law, share in self.parts)
        return sum(rest, first)


def RelaxingOgden(  # noqa: N802  (reads as a law)
    mu: Sequence[Value], alpha: Sequence[float] = (), eta: Sequence[Value] = (), tau: Sequence[Value] = ()
) -> Viscous:
    """Ogden terms of which the last relax, each in a branch of its own; those with exponent 2 are Neo-Hooke.

    Parameters
    ----------
    mu : sequence
        Shear moduli (Pa), of the terms that stay first.
    alpha : sequence of float
        As many exponents; left out, all are 2.
    eta : sequence
        Viscosities (Pa s) of the last terms, which then are `Maxwell` branches of finite viscoelasticity, τ = η/μ.
    tau : sequence
        In place of `eta`: relaxation times (s) of the last terms, which then are hereditary (`Branch`).

    Returns
    -------
    Viscous

    Raises
    ------
    InputError
        If both `eta` and `tau` are given, if they leave no term that stays, or for another number of exponents.

    Examples
    --------
    >>> law = RelaxingOgden([160.0, 970.0], [-25.7, -25.4], eta=[2190.0])
    >>> law.equilibrium, round(law.branches[0].tau, 3)
    (Ogden(mu=160.0, alpha=-25.7), 2.258)
    """
    exponents = alpha or (NEO_HOOKE,) * len(mu)
    if len(exponents) != len(mu):
        raise InputError("RelaxingOgden.alpha", f"{len(alpha)} values", f"as many as mu has: {len(mu)}")
    if eta and tau:
        raise InputError("RelaxingOgden.tau", f"{len(tau)} values", "eta or tau, not both")
    times = eta or tau
    if len(times) >= len(mu):
        raise InputError(f"RelaxingOgden.{'eta' if eta else 'tau'}", f"{len(times)} values", f"fewer than {len(mu)}")
    stay = len(mu) - len(times)
    terms = [NeoHooke(m) if a == NEO_HOOKE else Ogden(m, a) for m, a in zip(mu, exponents, strict=True)]
    law = terms[0] if stay == 1 else Ogden(tuple(mu[:stay]), tuple(exponents[:stay]))
    relaxing: type[Branch] | type[Maxwell] = Maxwell if eta else Branch
    return Viscous(law, tuple(relaxing(term, time) for term, time in zip(terms[stay:], times, strict=True)))


def scale(law: Law, factor: Value) -> Law:
    """The law with its moduli times a factor, a number or a field.

    >>> scale(Demiray(1e3, 5.0), 0.5)
    Demiray(mu=500.0, b=5.0)
    """
    if isinstance(law, Scaled):
        return scale(law.law, law.factor * factor)
    if isinstance(law, Sum):
        return Sum(tuple(scale(part, factor) for part in law.parts))
    if isinstance(law, Piecewise):
        return Piecewise(tuple((scale(part, factor), share) for part, share in law.parts))
    if type(law) not in MODULI:
        return Scaled(law, factor)
    return _with_moduli(law, lambda value: factor * value)


def stiffen(material: Viscous, factor: Value) -> Viscous:
    """The material with all moduli and viscosities times a factor: stiffer, as quick to relax."""

    def branch(of: Branch | Maxwell) -> Branch | Maxwell:
        law = scale(of.law, factor)
        return Maxwell(law, factor * of.eta) if isinstance(of, Maxwell) else Branch(law, of.tau)

    return Viscous(scale(material.equilibrium, factor), tuple(map(branch, material.branches)))


def shear_modulus(law: Law) -> Value:
    """Shear modulus at rest (Pa) by the constants of a known law, or by the energy of another.

    >>> shear_modulus(Scaled(Polynomial({(1, 0): 263.0, (0, 1): 263.0, (2, 0): 491.0}), 0.5))
    526.0
    """
    if isinstance(law, NeoHooke | UnsplitNeoHooke | Gent | Demiray):
        return law.mu
    if isinstance(law, Ogden):
        return sum(_listed(law.mu))
    if isinstance(law, Polynomial):
        return 2 * (law.c.get((1, 0), 0.0) + law.c.get((0, 1), 0.0))
    if isinstance(law, MooneyRivlin):
        return 2 * (law.c10 + law.c01)
    if isinstance(law, Scaled):
        return law.factor * shear_modulus(law.law)
    if isinstance(law, Sum):
        return sum(map(shear_modulus, law.parts))
    return initial_modulus(law)


def relaxation_time(branch: Branch | Maxwell) -> Value:
    """τ (s); of a Maxwell branch η/μ at small strain, by the constants."""
    return branch.eta / shear_modulus(branch.law) if isinstance(branch, Maxwell) else branch.tau


def elastic_law(material: Viscous, left: Callable[[float], float]) -> Law:
    """The elastic law with what is left of each branch, which is a function of its relaxation time (s).

    >>> elastic_law(RelaxingOgden([160.0, 970.0], [-25.7, -25.7], eta=[2190.0]), lambda tau: 0.5)
    Ogden(mu=645.0, alpha=-25.7)
    """
    parts = [(branch.law, left(float(relaxation_time(branch)))) for branch in material.branches]
    return merge([material.equilibrium, *(scale(law, share) for law, share in parts if share > 0)])


def law_after(material: Viscous, dt: float) -> Law:
    """The elastic law that one step of `dt` seconds from rest amounts to at small strain: W_∞ + Σ β_k W_k."""
    return elastic_law(material, lambda tau: float(step_factors(dt, np.array(tau))[1]))


def instantaneous_law(material: Viscous) -> Law:
    """What a sudden deformation meets, as few energies: W_∞ + Σ W_k."""
    return elastic_law(material, lambda tau: 1.0)


def hereditary_form(material: Viscous) -> Viscous:
    """The material with hereditary branches in place of Maxwell ones: the same springs and relaxation times."""
    return Viscous(material.equilibrium, tuple(Branch(b.law, relaxation_time(b)) for b in material.branches))


def is_neo_hooke(material: Viscous) -> bool:
    """Whether all parts of it are Neo-Hooke's law, which does not stiffen."""
    return all(isinstance(law, NeoHooke) for law in (material.equilibrium, *(b.law for b in material.branches)))


def merge(laws: Sequence[Law]) -> Law:
    """The sum of several laws as few energies: moduli are added where all else is the same.

    >>> merge([NeoHooke(100.0), Ogden(50.0, -20.0), NeoHooke(10.0), Ogden(5.0, -20.0)])
    Ogden(mu=(110.0, 55.0), alpha=(2.0, -20.0))
    >>> merge([Scaled(Gent(100.0, 0.1), 0.5), Gent(20.0, 0.1), NeoHooke(1.0)])
    Sum(parts=(Gent(mu=70.0, jm=0.1), NeoHooke(mu=1.0)))
    """
    groups = _grouped(_flat(laws), _addable)
    found = [group[0] if len(group) == 1 else _added(group) for group in groups]
    return found[0] if len(found) == 1 else Sum(tuple(found))


def _flat(laws: Sequence[Law]) -> list[Law]:
    """Without sums, and with factors in the moduli."""
    found: list[Law] = []
    for law in laws:
        inner = scale(law, 1.0) if isinstance(law, Scaled) else law
        found += _flat(inner.parts) if isinstance(inner, Sum) else [inner]
    return found


def _addable(one: Law, other: Law) -> bool:
    """Whether one law has the sum of both as its energy."""
    if _family(one) != _family(other) or type(one) not in MODULI:
        return False
    return isinstance(one, NeoHooke | Ogden | Polynomial) or _rest(one) == _rest(other)


def _rest(law: Law) -> list[Any]:
    """What a law has beside moduli."""
    return [getattr(law, f.name) for f in fields(cast(Any, law)) if f.name not in MODULI[type(law)]]


def _added(laws: Sequence[Law]) -> Law:
    """Of one family, with the same constants beside moduli."""
    if isinstance(laws[0], NeoHooke | Ogden):
        mu: dict[Value, Value] = {}  # by exponent
        for m, a in (term for law in laws for term in _terms(law)):
            mu[a] = mu[a] + m if a in mu else m
        if len(mu) > 1:
            return Ogden(tuple(mu.values()), tuple(mu))
        ((a, m),) = mu.items()
        return NeoHooke(m) if a == NEO_HOOKE else Ogden(m, a)
    if isinstance(laws[0], Polynomial):
        total: dict[tuple[int, int], Value] = {}
        for law in cast(Sequence[Polynomial], laws):
            for power, c in law.c.items():
                total[power] = total[power] + c if power in total else c
        return Polynomial(total)
    sums = {name: sum(getattr(law, name) for law in laws) for name in MODULI[type(laws[0])]}
    return replace(cast(Any, laws[0]), **sums)


def mix(tissues: Sequence[tuple[Viscous | Law, Value]]) -> Viscous:
    """One material for several tissues side by side, each where its share is 1 (elsewhere it is 0, at every quadrature point).

    Tissues of one family share one energy whose constants are fields; different families have one each, see `Piecewise`. The k-th
    Maxwell branch of all tissues is one branch, and so is the k-th hereditary one; a tissue that has fewer has none there.

    >>> import ngsolve as ngs
    >>> left = ngs.IfPos(ngs.x, 0.0, 1.0)
    >>> type(mix([(NeoHooke(1e3), left), (Ogden(2e3, -20.0), 1 - left)]).equilibrium).__name__
    'Ogden'
    >>> type(mix([(Gent(1e3, 0.1), left), (Ogden(2e3, -20.0), 1 - left)]).equilibrium).__name__
    'Piecewise'
    """
    shares = [share for _, share in tissues]
    materials = [viscous(law) for law, _ in tissues]

    def branches(kind: type) -> list[list[Any]]:
        own = [[b for b in material.branches if isinstance(b, kind)] for material in materials]
        most = max(map(len, own))
        return [[of[k] if k < len(of) else None for of in own] for k in range(most)]

    def law_of(each: Sequence[Any]) -> Law:
        return _mix([(branch and branch.law, share) for branch, share in zip(each, shares, strict=True)])

    def mean(each: Sequence[Any], name: str) -> Value:
        # 1 where there is no such branch: any will do
        return sum(
            share * (getattr(branch, name) if branch else 1.0) for branch, share in zip(each, shares, strict=True)
        )

    equilibrium = _mix([(m.equilibrium, share) for m, share in zip(materials, shares, strict=True)])
    flowing = [Maxwell(law_of(each), mean(each, "eta")) for each in branches(Maxwell)]
    remembering = [Branch(law_of(each), mean(each, "tau")) for each in branches(Branch)]
    return Viscous(equilibrium, (*flowing, *remembering))


def group_by_family(tissues: Mapping[str, Viscous | Law]) -> list[list[str]]:
    """Names of tissues in groups that have one energy each, by the families of their laws at rest.

    >>> group_by_family({"grey": NeoHooke(1e3), "white": Ogden(2e3, -20.0), "lesion": Gent(3e3, 0.1)})
    [['grey', 'white'], ['lesion']]
    """
    laws = {name: _simple(viscous(law).equilibrium) for name, law in tissues.items()}
    return _grouped(list(laws), lambda one, other: _alike(laws[one], laws[other]))


def _grouped(items: Sequence[T], alike: Callable[[T, T], bool]) -> list[list[T]]:
    """In groups of those that are like the first of their group."""
    groups: list[list[T]] = []
    for item in items:
        like = next((group for group in groups if alike(group[0], item)), None)
        if like is None:
            groups.append([item])
        else:
            like.append(item)
    return groups


def _mix(pairs: Sequence[Pair]) -> Law:
    """One law of several, a `Piecewise` one where they are of several families."""
    present = [(_simple(law), share) for law, share in pairs if law is not None]
    groups = _grouped(present, lambda one, other: _alike(one[0], other[0]))
    # A term of Ogden's without a modulus has no energy: so one energy does where a tissue has no such branch.
    if len(groups) == 1 and (len(present) == len(pairs) or isinstance(groups[0][0][0], NeoHooke | Ogden)):
        return _with_fields([(law and _simple(law), share) for law, share in pairs])
    return Piecewise(tuple((_with_fields(group), sum(share for _, share in group)) for group in groups))


def _simple(law: Law) -> Law:
    return merge([law]) if isinstance(law, Scaled | Sum) else law


def _family(law: Law) -> type:
    return Ogden if isinstance(law, NeoHooke) else type(law)


def _alike(one: Law, other: Law) -> bool:
    """Whether they are of one family, whose constants can be fields."""
    return one is other or (_family(one) == _family(other) and type(one) in FAMILIES)


def _with_fields(pairs: Sequence[Pair]) -> Law:
    """One law whose constants are each tissue's where it is."""
    laws = [law for law, _ in pairs if law is not None]
    if isinstance(laws[0], NeoHooke | Ogden):
        terms = [(_terms(law) if law is not None else [], share) for law, share in pairs]
        most = max(len(of) for of, _ in terms)
        padded = [(of + [(0.0, NEO_HOOKE)] * (most - len(of)), share) for of, share in terms]
        means = [[sum(share * of[k][i] for of, share in padded) for k in range(most)] for i in (0, 1)]
        if all(isinstance(law, NeoHooke) for law in laws):
            return NeoHooke(means[0][0])
        return Ogden(*means)
    if isinstance(laws[0], Polynomial):
        powers = dict.fromkeys(power for law in cast(list[Polynomial], laws) for power in law.c)
        c = {n: sum(share * cast(Polynomial, law).c.get(n, 0.0) for law, share in pairs) for n in powers}
        return Polynomial(c)
    if type(laws[0]) not in FAMILIES:
        return laws[0]  # the same for all
    names = [f.name for f in fields(cast(Any, laws[0]))]
    fields_of = {name: sum(share * getattr(law, name) for law, share in pairs) for name in names}
    return replace(cast(Any, laws[0]), **fields_of)


def _with_moduli(law: Law, change: Callable[[Value], Value]) -> Law:
    def changed(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: change(each) for key, each in value.items()}
        return tuple(map(change, value)) if isinstance(value, list | tuple | np.ndarray) else change(value)

    return replace(cast(Any, law), **{name: changed(getattr(law, name)) for name in MODULI[type(law)]})


def _terms(law: Law) -> list[tuple[Value, Value]]:
    """(μ, α) of each term of Ogden's law."""
    if isinstance(law, NeoHooke):
        return [(law.mu, NEO_HOOKE)]
    ogden = cast(Ogden, law)
    return list(zip(_listed(ogden.mu), _listed(ogden.alpha), strict=True))


def _listed(value: Any) -> list[Value]:
    return list(value) if isinstance(value, list | tuple | np.ndarray) else [value]
