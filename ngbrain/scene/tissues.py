# ruff: noqa: RUF009  (what the calls in class bodies return is a dataclasses.field)
"""What a tissue is made of, as scenes of both kinds say it: a name in the catalogue, or moduli of one's own."""

from __future__ import annotations

from dataclasses import dataclass

from ngbrain.fields import Section, choice, number, pattern
from ngbrain.materials import CATALOGUE, RelaxingOgden, Viscous
from ngbrain.materials.catalogue import Published, suggest
from ngbrain.materials.families import stiffen
from ngbrain.materials.viscous import viscous

LEAST_SCALE, MOST_SCALE = 1e-6, 1e6


@dataclass(frozen=True, kw_only=True)
class Constitutive(Section):
    """A law of shape for the regions that match a pattern.

    constants    name in the catalogue, which `ngbrain materials` lists
    mu, alpha    in its place: shear moduli (Pa) and Ogden exponents, of what stays first, then of relaxing branches
    eta          viscosities (Pa s) of the branches, of finite viscoelasticity
    tau          in place of eta: relaxation times (s) of the branches, hereditary
    scale        what all moduli and viscosities are multiplied by
    """

    region: str = pattern("region")
    constants: str | None = choice("constants", None, CATALOGUE, suggest)
    mu: tuple[float, ...] | None = number("mu_Pa", None, size=0)
    alpha: tuple[float, ...] | None = number("alpha", None, signed=True, size=0)
    eta: tuple[float, ...] | None = number("eta_Pa_s", None, size=0)
    tau: tuple[float, ...] | None = number("tau_s", None, size=0)
    scale: float | None = number("scale", None)

    def _check_law(self, path: str) -> None:
        for name in ("mu", "alpha", "eta", "tau"):
            self._need(not (self.constants and getattr(self, name)), path, name, "this key or constants, not both")
        self._need(not (self.eta and self.tau), path, "tau", "this key or eta_Pa_s, not both")
        fits = self.scale is None or LEAST_SCALE <= self.scale <= MOST_SCALE
        self._need(fits, path, "scale", f"a factor of {LEAST_SCALE:g} to {MOST_SCALE:g}")

    def _check_sizes(self, path: str) -> None:
        exponents = all(1e-3 <= abs(a) <= 1e3 for a in self.alpha or ())
        self._need(exponents, path, "alpha", "exponents of size 0.001 to 1000")
        self._need(all(1e-3 <= m <= 1e9 for m in self.mu or ()), path, "mu", "moduli of 0.001 to 1e9 Pa")

    @property
    def published(self) -> Published | None:
        """The catalogue's entry, None for moduli of one's own."""
        return CATALOGUE[self.constants] if self.constants else None

    def law(self) -> Viscous:
        """The law of shape."""
        entry = self.published
        found = viscous(entry.law()) if entry else RelaxingOgden(*(getattr(self, name) or () for name in OWN))
        return found if self.scale is None else stiffen(found, self.scale)

    @property
    def initial_modulus(self) -> float:
        """Shear modulus (Pa) of an instantaneous small strain."""
        modulus = self.published.initial_modulus if self.published else sum(self.mu or ())
        return modulus if self.scale is None else self.scale * modulus

    @property
    def cautions(self) -> list[str]:
        """What to know of the constants, in words."""
        entry = self.published
        if not entry or not entry.cautions:
            return []
        of = "" if entry.species == "none" else f"{entry.species} "
        return [f"{entry.name} ({of}{entry.region}): {'; '.join(entry.cautions)}"]


OWN = ("mu", "alpha", "eta", "tau")
"""Fields of moduli of one's own, as `RelaxingOgden` takes them."""
