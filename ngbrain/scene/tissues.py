# ruff: noqa: RUF009  (what the calls in class bodies return is a dataclasses.field)
"""Materials of the regions of a body."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from ngbrain.image.read.fibre_directions import CONVENTIONS
from ngbrain.materials import CATALOGUE, HolzapfelGasserOgden, Prony, RelaxingOgden, Viscous
from ngbrain.materials.catalogue import Published, suggest
from ngbrain.materials.families import is_neo_hooke, shear_modulus, stiffen
from ngbrain.materials.fibre import Fibre
from ngbrain.materials.named import NamedBranch, NamedLaw, from_folder
from ngbrain.materials.registry import REGISTRY
from ngbrain.materials.viscous import viscous
from ngbrain.schema.document import Section
from ngbrain.schema.fields import choice, choice_or_table, custom_table, number, path, pattern

if TYPE_CHECKING:
    from ngbrain.scene import Scene

LEAST_SCALE, MOST_SCALE = 1e-6, 1e6
NEARLY_INCOMPRESSIBLE, DENSITY = 1000.0, 1040.0
"""Defaults for tissue without further data: ratio of bulk to initial shear modulus, and density (kg/m³)."""
SWELLINGS = (-0.3, 1.0)
"""Smallest and largest relative change of a tissue's volume."""
LAWS = {
    "anyOf": [
        {"type": "object", "properties": {"name": {"enum": list(REGISTRY)}}, "required": ["name"]},
        {"type": "object", "properties": {"path": {"type": "string"}}, "required": ["path"]},
    ]
}
"""JSON schema of a law by its name or path; the registry checks its parameters."""
FIBRES_ALONE = 1e-6
"""Fraction of the modulus that Holzapfel's law keeps where its fibres are added to another law."""
OWN = ("mu", "alpha", "eta", "tau")
"""Fields of explicit moduli, the arguments of `RelaxingOgden`."""


@dataclass(frozen=True, kw_only=True)
class Tissue(Section):
    """The material of the regions that match a pattern: a name in the catalogue of published constants, or explicit moduli.

    Parameters
    ----------
    region
        A name or a regular expression.
    material
        Name in the catalogue, which `ngbrain materials` lists, or a law by its name with its parameters, such as
        { name = "Gent", mu_Pa = 900.0, jm = 0.5 }; `ngbrain materials --laws` lists these. A user-defined law by its path, such
        as { path = "my_laws.py:MyLaw", mu = 900.0 }: the file is executed; a scene beside a result.json may not name one.
    prony_g
        Relaxing fractions of that law's stress (a quasi-linear Prony series).
    prony_tau
        Relaxation times (s) of these fractions.
    maxwell
        Maxwell branches of finite viscoelasticity beside that law: for each the table of a law and its viscosity, such as
        [{ name = "Gent", mu_Pa = 400.0, jm = 0.5, eta_Pa_s = 900.0 }]; their laws are isotropic, and may differ from the
        equilibrium law.
    mu
        In place of `material`: shear moduli (Pa) of the equilibrium part, then of the viscoelastic branches.
    alpha
        Ogden exponents of the shear moduli; without them all parts are Neo-Hooke.
    eta
        Viscosities (Pa s) of the branches, of finite viscoelasticity.
    tau
        In place of viscosities: relaxation times (s) of the branches, hereditary (a Prony series).
    scale
        Factor of all moduli and viscosities.
    bulk_to_shear_ratio
        Bulk modulus over initial shear modulus. Without it and without Poisson's ratio it is the source's where it has one, else
        1000, with a warning that says so.
    poissons_ratio
        Poisson's ratio for instantaneous small strain, in place of the ratio of moduli: K = 2μ₀(1 + ν)/3(1 - 2ν).
    density
        Mass over volume; without it 1040 kg/m³, with a warning where it matters.
    loss_tangent
        Loss tangent G″/G′ in harmonic problems, for tissue without branches.
    swelling
        Change of the stress-free volume, the same in all directions, that grows with the loads: positive where tissue takes up
        fluid (oedema), negative where it loses it (mannitol). Its mass is unchanged.
    fibre_stiffness
        k₁ (Pa) of the fibres of Holzapfel, Gasser and Ogden.
    fibre_exponent
        k₂ of the fibres: how fast their stiffness grows with strain.
    fibre
        Direction of the fibres.
    fibre_map
        Path of a NIfTI file of directions in the body's own axes, in place of one direction: vectors (x, y, z, 3), or tensors of
        diffusion (x, y, z, 6) or (x, y, z, 3, 3), of which the principal direction is used; 0 where none is known.
    fibre_map_convention
        Axes of its components. fsl: the voxels' own, the first reversed where the affine keeps handedness, tensors
        xx xy xz yy yz zz; mrtrix: the scanner's, tensors xx yy zz xy xz yz; nifti: the scanner's, tensors xx xy yy xz yz zz.
    shear_modulus_map
        Path of a NIfTI volume of shear moduli (Pa) for instantaneous small strain, in the body's coordinates (mm): all moduli
        and viscosities are scaled to it, so that only their ratios are used.
    """

    region: str = pattern("region", ".*")
    material: str | NamedLaw | None = choice_or_table(
        "material",
        CATALOGUE,
        NamedLaw.read,
        LAWS,
        "a name in the catalogue, which `ngbrain materials` lists, or a table of a law's name and its parameters",
        suggest,
        from_folder,
    )
    mu: tuple[float, ...] | None = number("mu_Pa", None, size=0)
    alpha: tuple[float, ...] | None = number("alpha", None, signed=True, size=0)
    eta: tuple[float, ...] | None = number("eta_Pa_s", None, size=0)
    tau: tuple[float, ...] | None = number("tau_s", None, size=0)
    prony_g: tuple[float, ...] | None = number("prony_g", None, size=0)
    prony_tau: tuple[float, ...] | None = number("prony_tau_s", None, size=0)
    maxwell: tuple[NamedBranch, ...] | None = custom_table(
        "maxwell",
        NamedBranch.read,
        LAWS,
        "a table of a law, its parameters and eta_Pa_s, or a list of them",
        from_folder,
    )
    scale: float | None = number("scale", None)
    bulk_to_shear_ratio: float | None = number("bulk_to_shear_ratio", None)
    poissons_ratio: float | None = number("poissons_ratio", None, least=0.0)
    density: float | None = number("density_kg_m3", None)
    loss_tangent: float = number("loss_tangent", 0.0, least=0.0)
    swelling: float = number("swelling_percent", 0.0, signed=True)
    fibre_stiffness: float | None = number("fibre_stiffness_Pa", None)
    fibre_exponent: float = number("fibre_exponent", 1.0)
    fibre: tuple[float, float, float] | None = number("fibre", None, signed=True, size=3)
    fibre_map: str | None = path("fibre_map", None, "the path of a volume (.nii, .nii.gz)", (".nii", ".nii.gz"))
    fibre_map_convention: str | None = choice("fibre_map_convention", None, tuple(CONVENTIONS))
    shear_modulus_map: str | None = path(
        "shear_modulus_map", None, "the path of a volume (.nii, .nii.gz)", (".nii", ".nii.gz")
    )

    def _check(self, path: str, scene: Scene) -> None:
        own = [name for name in OWN if getattr(self, name)]
        for name in own:
            self._need(not self.material, path, name, "this key or material, not both")
        self._need(self.material or own, path, "material", "material, a name in the catalogue or a law, or mu_Pa")
        self._check_prony(path)
        if not self.material:
            self._check_moduli(path)
        fits = self.scale is None or LEAST_SCALE <= self.scale <= MOST_SCALE
        self._need(fits, path, "scale", f"a factor of {LEAST_SCALE:g} to {MOST_SCALE:g}")
        given = self.bulk_to_shear_ratio is not None and self.poissons_ratio is not None
        self._need(not given, path, "poissons_ratio", "this key or bulk_to_shear_ratio, not both")
        self._need(self.poissons_ratio is None or self.poissons_ratio < 0.5, path, "poissons_ratio", "less than 0.5")
        self._need(1e-3 <= self.volume_ratio <= 1e9, path, "bulk_to_shear_ratio", "a ratio of 0.001 to 1e9")
        low, high = SWELLINGS
        wanted = f"a change of volume of {100 * low:g} to {100 * high:g} percent"
        self._need(low <= self.swelling <= high, path, "swelling", wanted)
        still = scene.time.frequency is None or not self.swelling
        self._need(still, path, "swelling", "this key left out: a harmonic problem has amplitudes only")
        wanted = "a direction to go with fibre_stiffness_Pa, and only with it, or fibre_map"
        directed = self.fibre is not None or self.fibre_map is not None
        self._need((self.fibre_stiffness is None) != directed, path, "fibre", wanted)
        self._need(self.fibre is None or self.fibre_map is None, path, "fibre_map", "this key or fibre, not both")
        wanted = (
            f"{', '.join(CONVENTIONS)}: the axes of the components" if self.fibre_map else "this key only with a map"
        )
        self._need(
            (self.fibre_map is None) == (self.fibre_map_convention is None), path, "fibre_map_convention", wanted
        )
        self._need(self.fibre is None or any(self.fibre), path, "fibre", "a direction: not all 0")
        if scene.cleft is not None:
            both = self.shear_modulus_map is not None and scene.geometry.stiffness_map is not None
            self._need(not both, path, "shear_modulus_map", "this key or geometry.stiffness_map, not both")

    def _check_moduli(self, path: str) -> None:
        mu, alpha, eta, tau = (getattr(self, name) or () for name in OWN)
        self._need(mu, path, "mu", "moduli to go with alpha, eta_Pa_s and tau_s")
        self._need(
            len(alpha) in (0, len(mu)) and all(alpha),
            path,
            "alpha",
            f"as many values as mu_Pa, {len(mu)}, none of them 0",
        )
        self._need(not (eta and tau), path, "tau", "this key or eta_Pa_s, not both")
        times, branches = "tau" if tau else "eta", len(eta or tau)
        wanted = f"one value fewer than mu_Pa: {len(mu) - 1}" if not alpha else f"fewer values than mu_Pa, {len(mu)}"
        self._need(branches == len(mu) - 1 or (alpha and branches < len(mu)), path, times, wanted)
        self._need(all(1e-3 <= abs(a) <= 1e3 for a in alpha), path, "alpha", "exponents of size 0.001 to 1000")
        self._need(all(1e-3 <= m <= 1e9 for m in mu), path, "mu", "moduli of 0.001 to 1e9 Pa")

    def _check_prony(self, path: str) -> None:
        g, tau = self.prony_g or (), self.prony_tau or ()
        wanted = "this key only with a law that is not viscoelastic itself: material = { name = ... }"
        self._need(not self.maxwell or isinstance(self.material, NamedLaw), path, "maxwell", wanted)
        if not (g or tau):
            return
        self._need(isinstance(self.material, NamedLaw), path, "prony_g", wanted)
        self._need(not self.maxwell, path, "maxwell", "this key or prony_g, not both")
        self._need(len(g) == len(tau), path, "prony_tau", f"as many values as prony_g, {len(g)}")
        self._need(sum(g) < 1, path, "prony_g", "shares that add up to less than 1")

    @property
    def _named(self) -> tuple[NamedLaw, ...]:
        """Laws by name, including those of branches."""
        own = (self.material,) if isinstance(self.material, NamedLaw) else ()
        return own + tuple(branch.named for branch in self.maxwell or ())

    @property
    def published(self) -> Published | None:
        """The catalogue's entry; None for explicit moduli."""
        return CATALOGUE[self.material] if isinstance(self.material, str) else None

    def law(self) -> Viscous:
        """The isochoric law."""
        found = self._law()
        return found if self.scale is None else stiffen(found, self.scale)

    def _law(self) -> Viscous:
        if isinstance(self.material, NamedLaw):
            law = self.material.law()
            if self.maxwell:
                return Viscous(law, tuple(each.branch() for each in self.maxwell))
            return Prony(law, self.prony_g, self.prony_tau) if self.prony_g and self.prony_tau else viscous(law)
        entry = self.published
        return viscous(entry.law()) if entry else RelaxingOgden(*(getattr(self, name) or () for name in OWN))

    def with_fibres(self, law: Viscous, fibre: Fibre) -> Viscous:
        """Add this tissue's fibres to the equilibrium part of a law.

        Parameters
        ----------
        law : Viscous
        fibre : tuple of float or CoefficientFunction
            Direction, constant or a field.

        Returns
        -------
        Viscous
        """
        if self.fibre_stiffness is None:
            return law
        soft, stiffness = FIBRES_ALONE * self.initial_modulus, self.fibre_stiffness * (self.scale or 1.0)
        return law + HolzapfelGasserOgden(soft, stiffness, self.fibre_exponent, 0.0, fibre)

    @property
    def initial_modulus(self) -> float:
        """Shear modulus (Pa) for instantaneous small strain."""
        if isinstance(self.material, NamedLaw):
            modulus = sum(float(shear_modulus(each.law())) for each in self._named)
        else:
            modulus = self.published.initial_modulus if self.published else sum(self.mu or ())
        return modulus if self.scale is None else self.scale * modulus

    @property
    def volume_ratio(self) -> float:
        """Ratio of bulk to initial shear modulus: the scene's, the source's or the default."""
        entry = self.published
        if self.bulk_to_shear_ratio is not None:
            return self.bulk_to_shear_ratio
        if self.poissons_ratio is None and entry and entry.bulk:
            return entry.bulk / entry.initial_modulus
        nu = self.poissons_ratio if self.poissons_ratio is not None else entry.poisson if entry else None
        return NEARLY_INCOMPRESSIBLE if nu is None else 2 * (1 + nu) / (3 * (1 - 2 * nu))

    @property
    def bulk(self) -> float:
        """Bulk modulus K (Pa)."""
        return self.volume_ratio * self.initial_modulus

    @property
    def rho(self) -> float:
        """Density (kg/m³), the scene's or the default."""
        return DENSITY if self.density is None else self.density

    @property
    def cautions(self) -> list[str]:
        """Notes on the constants and assumptions on compressibility."""
        entry, found = self.published, list[str]()
        found += dict.fromkeys(caution for each in self._named for caution in each.cautions)
        if entry and entry.cautions:
            of = "" if entry.species == "none" else f"{entry.species} "
            found.append(f"{entry.name} ({of}{entry.region}): {'; '.join(entry.cautions)}")
        if self.bulk_to_shear_ratio is None and self.poissons_ratio is None:
            ratio = f"bulk_to_shear_ratio is not given: {self.volume_ratio:.4g} is"
            source = "bulk modulus" if entry and entry.bulk else "Poisson's ratio" if entry and entry.poisson else ""
            found.append(
                f"{ratio} used, of the source's {source}" if source else f"{ratio} assumed, nearly incompressible"
            )
        return found

    def with_alpha(self, alpha: float) -> Tissue:
        """Ogden's law with one exponent and the same moduli and relaxation times; Neo-Hooke has no exponent and is unchanged."""
        law = self.law()
        if is_neo_hooke(law):
            return self
        mu = tuple(float(shear_modulus(part)) for part in (law.equilibrium, *(branch.law for branch in law.branches)))
        times: dict[str, Any] = {
            "eta": tuple(b.eta for b in law.maxwell_branches),
            "tau": tuple(b.tau for b in law.hereditary_branches),
        }
        own: dict[str, Any] = {name: values or None for name, values in times.items()}
        own |= {
            "prony_g": None,
            "prony_tau": None,
            "maxwell": None,
            "mu": mu,
            "alpha": (alpha,) * len(mu),
            "bulk_to_shear_ratio": self.volume_ratio,
            "poissons_ratio": None,
        }
        return replace(self, material=None, scale=None, **own)

    def with_scale(self, factor: float) -> Tissue:
        """Moduli and viscosities multiplied by `factor`; relaxation times are unchanged."""
        return replace(self, scale=factor * (self.scale or 1.0))
