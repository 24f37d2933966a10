"""Families of laws: scaling of moduli, sums of laws as few energies, and one law for several tissues.

A family is a class of laws whose energies differ only in constants: Neo-Hooke and Ogden (Neo-Hooke is Ogden with α
= 2), and every other law by itself. Tissues of one family cost as much as one tissue, as their constants may be
fields.
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
from ngbrain.materials.isotropic import Demiray, Gent, MooneyRivlin, NeoHooke, Ogden, Polynomial, UnsplitNeoHooke
from ngbrain.materials.maxwell import Maxwell
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
"""Parameters of a law that its energy is linear in."""
FAMILIES = (NeoHooke, Ogden, Polynomial, Gent, Demiray)
"""Laws all of whose constants may be fields."""
NEO_HOOKE = 2.0
"""Exponent for which Ogden's law is Neo-Hooke's."""
T = TypeVar("T")
Pair = tuple[Law | None, Value]
"""A tissue's law, None where it has none, and the tissue's indicator function."""


@dataclass(frozen=True, repr=False)
class Piecewise(Composite):
    """Several laws, each evaluated only where its indicator exceeds one half; elsewhere its energy may be undefined.

    Parameters
    ----------
    parts : tuple of tuple of (Law, float or CoefficientFunction)
        Pairs of a law and its indicator function: 1 where the law holds and 0 elsewhere, at every quadrature point.

    Examples
    --------
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
        """Energy density (Pa) at principal logarithmic strains, see `density_of_log_strains`."""
        first, *rest = (ngs.IfPos(share - 0.5, density_of_log_strains(law, logs), 0.0) for law, share in self.parts)
        return sum(rest, first)


def RelaxingOgden(  # noqa: N802  (reads as a law)
    mu: Sequence[Value], alpha: Sequence[float] = (), eta: Sequence[Value] = (), tau: Sequence[Value] = ()
) -> Viscous:
    """Viscoelastic Ogden material: the last terms are viscoelastic branches; terms with exponent 2 are Neo-Hooke.

    Parameters
    ----------
    mu : sequence of float or CoefficientFunction
        Shear moduli (Pa); those of the equilibrium terms come first.
    alpha : sequence of float, optional
        Exponents, one per modulus; 2 where left out.
    eta : sequence of float or CoefficientFunction, optional
        Viscosities (Pa s) of the last terms, which become `Maxwell` branches of finite viscoelasticity, τ = η/μ.
    tau : sequence of float or CoefficientFunction, optional
        Instead of `eta`: relaxation times (s) of the last terms, which become hereditary branches (`Branch`).

    Returns
    -------
    Viscous
        The viscoelastic material.

    Raises
    ------
    InputError
        Both `eta` and `tau` are given, no equilibrium term remains, or the numbers of moduli and exponents differ.

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
    n_equilibrium = len(mu) - len(times)
    terms = [NeoHooke(m) if a == NEO_HOOKE else Ogden(m, a) for m, a in zip(mu, exponents, strict=True)]
    law = terms[0] if n_equilibrium == 1 else Ogden(tuple(mu[:n_equilibrium]), tuple(exponents[:n_equilibrium]))
    make_branch: type[Branch] | type[Maxwell] = Maxwell if eta else Branch
    return Viscous(law, tuple(make_branch(term, time) for term, time in zip(terms[n_equilibrium:], times, strict=True)))


def scale(law: Law, factor: Value) -> Law:
    """Multiply the moduli of a law by a factor.

    Parameters
    ----------
    law : Law
        Law to scale.
    factor : float or CoefficientFunction
        A number or a field.

    Returns
    -------
    Law
        A law of the same class where its moduli are known (`MODULI`), else a `Scaled` one.

    Examples
    --------
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
    """Multiply all moduli and viscosities of a material by a factor; relaxation times stay the same.

    Parameters
    ----------
    material : Viscous
        Viscoelastic material.
    factor : float or CoefficientFunction
        A number or a field.

    Returns
    -------
    Viscous
        The scaled material.
    """

    def branch(of: Branch | Maxwell) -> Branch | Maxwell:
        law = scale(of.law, factor)
        return Maxwell(law, factor * of.eta) if isinstance(of, Maxwell) else Branch(law, of.tau)

    return Viscous(scale(material.equilibrium, factor), tuple(map(branch, material.branches)))


def shear_modulus(law: Law) -> Value:
    """Initial shear modulus (Pa) from the constants of a known law, or from the energy of another.

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
    """Relaxation time τ (s); for a Maxwell branch η/μ at small strain."""
    return branch.eta / shear_modulus(branch.law) if isinstance(branch, Maxwell) else branch.tau


def elastic_law(material: Viscous, left: Callable[[float], float]) -> Law:
    """Elastic law with a share of each viscoelastic branch.

    Parameters
    ----------
    material : Viscous
        Viscoelastic material.
    left : callable
        Share of a branch, from 0 to 1, as a function of its relaxation time (s).

    Returns
    -------
    Law
        W_∞ + Σ share(τ_k) W_k, merged into few energies.

    Examples
    --------
    >>> elastic_law(RelaxingOgden([160.0, 970.0], [-25.7, -25.7], eta=[2190.0]), lambda tau: 0.5)
    Ogden(mu=645.0, alpha=-25.7)
    """
    parts = [(branch.law, left(float(relaxation_time(branch)))) for branch in material.branches]
    return merge([material.equilibrium, *(scale(law, share) for law, share in parts if share > 0)])


def law_after(material: Viscous, dt: float) -> Law:
    """Elastic law equivalent to one time step from rest at small strain, W_∞ + Σ β_k W_k.

    Parameters
    ----------
    material : Viscous
        Viscoelastic material.
    dt : float
        Time step (s).

    Returns
    -------
    Law
        The elastic law.
    """
    return elastic_law(material, lambda tau: float(step_factors(dt, np.array(tau))[1]))


def instantaneous_law(material: Viscous) -> Law:
    """Instantaneous elastic law W_∞ + Σ W_k, merged into few energies."""
    return elastic_law(material, lambda tau: 1.0)


def hereditary_form(material: Viscous) -> Viscous:
    """The material with hereditary branches in place of Maxwell ones: same springs, same relaxation times."""
    return Viscous(material.equilibrium, tuple(Branch(b.law, relaxation_time(b)) for b in material.branches))


def is_neo_hooke(material: Viscous) -> bool:
    """Whether the equilibrium law and all branches are Neo-Hooke's."""
    return all(isinstance(law, NeoHooke) for law in (material.equilibrium, *(b.law for b in material.branches)))


def merge(laws: Sequence[Law]) -> Law:
    """Sum of laws with as few energies as possible: moduli are added where all other constants agree.

    >>> merge([NeoHooke(100.0), Ogden(50.0, -20.0), NeoHooke(10.0), Ogden(5.0, -20.0)])
    Ogden(mu=(110.0, 55.0), alpha=(2.0, -20.0))
    >>> merge([Scaled(Gent(100.0, 0.1), 0.5), Gent(20.0, 0.1), NeoHooke(1.0)])
    Sum(parts=(Gent(mu=70.0, jm=0.1), NeoHooke(mu=1.0)))
    """
    groups = _grouped(_flat(laws), _addable)
    found = [group[0] if len(group) == 1 else _added(group) for group in groups]
    return found[0] if len(found) == 1 else Sum(tuple(found))


def _flat(laws: Sequence[Law]) -> list[Law]:
    """The laws without sums, with scale factors moved into the moduli."""
    found: list[Law] = []
    for law in laws:
        inner = scale(law, 1.0) if isinstance(law, Scaled) else law
        found += _flat(inner.parts) if isinstance(inner, Sum) else [inner]
    return found


def _addable(one: Law, other: Law) -> bool:
    """Whether the sum of both is again a law of the same class."""
    if _family(one) != _family(other) or type(one) not in MODULI:
        return False
    return isinstance(one, NeoHooke | Ogden | Polynomial) or _rest(one) == _rest(other)


def _rest(law: Law) -> list[Any]:
    """Constants of a law other than its moduli."""
    return [getattr(law, f.name) for f in fields(cast(Any, law)) if f.name not in MODULI[type(law)]]


def _added(laws: Sequence[Law]) -> Law:
    """Sum of laws of one family with the same constants other than moduli."""
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
    """One material for several tissues, each where its indicator function is 1 (elsewhere 0, at every quadrature point).

    Tissues of one family share one energy whose constants are fields; different families have one each, see
    `Piecewise`. The k-th Maxwell branches of all tissues are merged into one branch, and so are the k-th hereditary
    ones. A tissue with fewer branches has none there.

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
        by_tissue = [[b for b in material.branches if isinstance(b, kind)] for material in materials]
        most = max(map(len, by_tissue))
        return [[tissue[k] if k < len(tissue) else None for tissue in by_tissue] for k in range(most)]

    def law_of(each: Sequence[Any]) -> Law:
        return _mix([(branch and branch.law, share) for branch, share in zip(each, shares, strict=True)])

    def mean(each: Sequence[Any], name: str) -> Value:
        # any value, here 1, where there is no such branch
        return sum(
            share * (getattr(branch, name) if branch else 1.0) for branch, share in zip(each, shares, strict=True)
        )

    equilibrium = _mix([(m.equilibrium, share) for m, share in zip(materials, shares, strict=True)])
    maxwell = [Maxwell(law_of(each), mean(each, "eta")) for each in branches(Maxwell)]
    hereditary = [Branch(law_of(each), mean(each, "tau")) for each in branches(Branch)]
    return Viscous(equilibrium, (*maxwell, *hereditary))


def group_by_family(tissues: Mapping[str, Viscous | Law]) -> list[list[str]]:
    """Groups of tissues that share one energy, by the families of their equilibrium laws.

    >>> group_by_family({"grey": NeoHooke(1e3), "white": Ogden(2e3, -20.0), "lesion": Gent(3e3, 0.1)})
    [['grey', 'white'], ['lesion']]
    """
    laws = {name: _simple(viscous(law).equilibrium) for name, law in tissues.items()}
    return _grouped(list(laws), lambda one, other: _alike(laws[one], laws[other]))


def _grouped(items: Sequence[T], alike: Callable[[T, T], bool]) -> list[list[T]]:
    """Groups of items that are equivalent to the first of their group."""
    groups: list[list[T]] = []
    for item in items:
        like = next((group for group in groups if alike(group[0], item)), None)
        if like is None:
            groups.append([item])
        else:
            like.append(item)
    return groups


def _mix(pairs: Sequence[Pair]) -> Law:
    """One law of several; a `Piecewise` one where they are of several families."""
    present = [(_simple(law), share) for law, share in pairs if law is not None]
    groups = _grouped(present, lambda one, other: _alike(one[0], other[0]))
    # An Ogden term with modulus 0 has no energy: one law suffices where a tissue has no such branch.
    if len(groups) == 1 and (len(present) == len(pairs) or isinstance(groups[0][0][0], NeoHooke | Ogden)):
        return _with_fields([(law and _simple(law), share) for law, share in pairs])
    return Piecewise(tuple((_with_fields(group), sum(share for _, share in group)) for group in groups))


def _simple(law: Law) -> Law:
    return merge([law]) if isinstance(law, Scaled | Sum) else law


def _family(law: Law) -> type:
    return Ogden if isinstance(law, NeoHooke) else type(law)


def _alike(one: Law, other: Law) -> bool:
    """Whether two laws are of one family, all of whose constants may be fields."""
    return one is other or (_family(one) == _family(other) and type(one) in FAMILIES)


def _with_fields(pairs: Sequence[Pair]) -> Law:
    """One law whose constants are fields, each tissue's constants where the tissue is."""
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
    """(μ, α) of each Ogden term."""
    if isinstance(law, NeoHooke):
        return [(law.mu, NEO_HOOKE)]
    ogden = cast(Ogden, law)
    return list(zip(_listed(ogden.mu), _listed(ogden.alpha), strict=True))


def _listed(value: Any) -> list[Value]:
    return list(value) if isinstance(value, list | tuple | np.ndarray) else [value]
