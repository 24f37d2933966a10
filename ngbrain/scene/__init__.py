# ruff: noqa: RUF009  (what the calls in class bodies return is a dataclasses.field)
"""A scene as plain data: what is operated on, with what, how, and how finely it is computed.

SI units inside; in TOML the unit is the end of the key (`width_mm`, `ramp_s`, `mu_Pa`): `ngbrain.fields` reads and writes.
A part checks its own fields when it is made (also in Python), a `Scene` what is between fields and parts.
"""

from __future__ import annotations

import math
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any
from typing import Protocol as Interface

import numpy as np

from ngbrain.errors import InputError, nearest
from ngbrain.fields import Document, Section, brief, choice, entries, number, pattern, table, text, whole
from ngbrain.materials.families import is_neo_hooke, shear_modulus
from ngbrain.mesh.cleft import Cleft as Slot
from ngbrain.mesh.shapes import Ellipsoids
from ngbrain.scene.programs import Ask, Protocol, Retraction
from ngbrain.scene.tissues import Constitutive

WIDEST = 80e-3
"""Diameter (m) of a craniotomy; from a wider one the surface of the brain curves too far away."""
NARROWEST = 4e-3
"""Width (m) of a blade on whose face pressure can be read, which is done off its edges."""
FACED = 5e-3
"""Height (m) of wall above a blade's tip, where the pressure at the tip is read."""
NEARLY_INCOMPRESSIBLE = 1000.0
"""Bulk over shear modulus of tissue of which nothing else is known."""


class Openable(Interface):
    """A head, as far as a scene has to know: see `ngbrain.surgery.heads`."""

    def point(self, voxel: Sequence[float]) -> np.ndarray:
        """The place (m) of a voxel of the scan's file, counted from 0."""

    def cleft_to(
        self,
        target: np.ndarray,
        opening: float = ...,
        width: float = ...,
        approach: np.ndarray | None = None,
        across: np.ndarray | None = None,
    ) -> Slot:
        """The slot from the surface to a target (m), by the shortest way or along `approach`."""


@dataclass(frozen=True, kw_only=True)
class Body(Section):
    """The head: which; element sizes (m) on the cleft, under the craniotomy and elsewhere; polynomial order.

    head    idealised; mni152, the average brain that nilearn brings along; or scan, with the T1's file as `image`
    shear_modulus_map    file of shear moduli or shear stiffness, in any unit: its ratio to the mean over each tissue multiplies
                         that tissue's moduli
    shear_modulus_space  head: it lies in the head as it is; mni152: it lies in the template, which is brought to the head
    """

    head: str = choice("head", "idealised", ["idealised", "mni152", "scan"])
    image: str | None = text("image", None, "the path of a NIfTI file", lambda raw: raw.strip())
    shear_modulus_map: str | None = text(
        "shear_modulus_map", None, "the path of a NIfTI file, or of a ZIP archive of one", lambda raw: raw.strip()
    )
    shear_modulus_space: str | None = choice("shear_modulus_space", None, ["head", "mni152"])
    site: float = number("site_mm", 3e-3, least=0.2)
    near: float = number("near_mm", 8e-3, least=0.5)
    far: float = number("far_mm", 24e-3, least=2.0)
    order: int = whole("order", 2, 2, 4)

    def _check(self, path: str, scene: Scene) -> None:
        wanted = "a file to go with head = 'scan', and with no other head"
        self._need((self.head == "scan") == (self.image is not None), path, "image", wanted)
        mapped, space = self.shear_modulus_map is not None, self.shear_modulus_space is not None
        wanted = "this key left out: the idealised head is not that of anybody who was measured"
        self._need(not mapped or self.head != "idealised", path, "shear_modulus_map", wanted)
        wanted = "head or mni152, to go with body.shear_modulus_map" if mapped else "this key only with a map"
        self._need(
            space if mapped and self.head == "scan" else mapped or not space, path, "shear_modulus_space", wanted
        )
        self._need(self.near >= self.site, path, "near", f"at least {self.shown('site'):g}, body.site_mm")
        self._need(self.far >= self.near, path, "far", f"at least {self.shown('near'):g}, body.near_mm")


@dataclass(frozen=True, kw_only=True)
class Tissue(Constitutive):
    """What the regions that match a pattern are made of, by `constants` or by `mu`: see `Constitutive`.

    mu           one alone is Neo-Hooke, not relaxing; else the part that stays first, then branches
    alpha        as many Ogden exponents
    eta, tau     of the branches, one fewer
    bulk_ratio   bulk modulus / initial shear modulus; None: the source's where `constants` have one, else `NEARLY_INCOMPRESSIBLE`
    """

    bulk_ratio: float | None = number("bulk_ratio", None)

    def _check(self, path: str, scene: Scene) -> None:
        self._check_law(path)
        mu, alpha, eta, tau = self.mu or (), self.alpha or (), self.eta or (), self.tau or ()
        if not self.constants:
            self._need(mu or alpha or eta or tau, path, "constants", "constants, a name in the catalogue, or mu_Pa")
            self._need(mu, path, "mu", "moduli to go with alpha, eta_Pa_s and tau_s")
            fits = len(alpha) == len(mu) or len(mu) == 1 > len(alpha)
            self._need(fits and all(alpha), path, "alpha", f"as many values as mu_Pa, {len(mu)}, none of them 0")
            times = "tau" if tau else "eta"
            self._need(len(eta or tau) == len(mu) - 1, path, times, f"one value fewer than mu_Pa: {len(mu) - 1}")
        self._check_sizes(path)
        self._need(1e-3 <= self.volume_ratio <= 1e9, path, "bulk_ratio", "a ratio of 0.001 to 1e9")

    @property
    def volume_ratio(self) -> float:
        """Bulk modulus over initial shear modulus, the scene's, the source's or the one that is assumed."""
        if self.bulk_ratio is not None:
            return self.bulk_ratio
        entry = self.published
        return entry.bulk / entry.initial_modulus if entry and entry.bulk else NEARLY_INCOMPRESSIBLE

    @property
    def bulk(self) -> float:
        """Bulk modulus K (Pa)."""
        return self.volume_ratio * self.initial_modulus

    @property
    def cautions(self) -> list[str]:
        """What to know of the constants, and what is assumed, in words."""
        entry, found = self.published, super().cautions
        if self.bulk_ratio is not None:
            return found
        if entry and entry.bulk:
            return [*found, f"bulk_ratio is not given: {self.volume_ratio:.4g} is used, of the source's bulk modulus"]
        own = f" (the source has a Poisson's ratio of {entry.poisson:g})" if entry and entry.poisson else ""
        return [*found, f"bulk_ratio is not given: {self.volume_ratio:g} is assumed, nearly incompressible{own}"]

    def with_alpha(self, alpha: float) -> Tissue:
        """The same moduli and times with Ogden's law and one exponent; Neo-Hooke, which has none, stays."""
        law = self.law()
        if is_neo_hooke(law):
            return self
        mu = tuple(float(shear_modulus(part)) for part in (law.equilibrium, *(branch.law for branch in law.branches)))
        times: dict[str, Any] = {"eta": tuple(b.eta for b in law.flowing), "tau": tuple(b.tau for b in law.hereditary)}
        own: dict[str, Any] = {name: values or None for name, values in times.items()}
        own |= {"mu": mu, "alpha": (alpha,) * len(mu), "bulk_ratio": self.volume_ratio}
        return replace(self, constants=None, scale=None, **own)

    def scaled(self, factor: float) -> Tissue:
        """Moduli and viscosities times `factor`, so that times stay."""
        return replace(self, scale=factor * (self.scale or 1.0))


@dataclass(frozen=True, kw_only=True)
class Support(Section):
    """Pattern of the boundaries that are held, and of those among them that slide instead, without leaving what they lie on."""

    fixed: str = pattern("fixed", "skull")
    sliding: str | None = pattern("sliding", None)


@dataclass(frozen=True, kw_only=True)
class Cleft(Section):
    """The opening: centre of its floor (m), size along (`width`) and between its walls, diameter of the craniotomy (m).

    voxel      the centre of the floor as a voxel of the scan's file, counted from 0, in place of `target`
    approach   direction from the target outwards; None: the shortest way
    across     direction from wall to wall; None: left to right
    """

    target: tuple[float, float, float] | None = number("target_mm", None, signed=True, size=3)
    voxel: tuple[float, float, float] | None = number("target_voxel", None, signed=True, size=3)
    width: float = number("width_mm", 12e-3)
    opening: float = number("opening_mm", 4e-3, least=0.1)
    craniotomy: float = number("craniotomy_mm", 40e-3)
    approach: tuple[float, float, float] | None = number("approach", None, signed=True, size=3)
    across: tuple[float, float, float] | None = number("across", None, signed=True, size=3)

    def _check(self, path: str, scene: Scene) -> None:
        diagonal = math.hypot(self.width, self.opening)
        wanted = f"at least 2 more than {1e3 * diagonal:.4g}, the diagonal of cleft.width_mm by cleft.opening_mm"
        self._need(self.craniotomy >= diagonal + 2e-3, path, "craniotomy", wanted)
        self._need(self.craniotomy <= WIDEST, path, "craniotomy", f"at most {1e3 * WIDEST:g}")
        for name in ("approach", "across"):
            largest = max(map(abs, getattr(self, name) or (1,)))
            self._need(1e-3 <= largest <= 1e3, path, name, "a direction: not all 0, and none beyond 1000")
        wanted = "a length in mm in each of 3 places, or cleft.target_voxel; not both"
        self._need((self.target is None) != (self.voxel is None), path, "target", wanted)
        of_scan = scene.body.head != "idealised"
        self._need(of_scan or self.voxel is None, path, "voxel", "cleft.target_mm: the idealised head has no voxels")
        self._need(max(map(abs, self.target or (0,))) < 1, path, "target", "a point inside the brain")
        wanted = "a direction: no way out is the shortest one from the centre of the brain, cleft.target_mm = [0, 0, 0]"
        self._need(of_scan or self.approach or any(self.target or ()), path, "approach", wanted)

    def slot(self, head: Openable) -> Slot:
        """Where it lies in a head; raises `InputError` where it cannot."""
        directions = [None if way is None else np.array(way) for way in (self.approach, self.across)]
        target = head.point(self.voxel) if self.voxel else np.array(self.target)
        return head.cleft_to(target, self.opening, self.width, *directions)

    def wall(self, head: Openable) -> float:
        """Height (m) of the wall that the blade pushes, floor to surface, in its middle."""
        slot = self.slot(head)
        try:
            return head.cleft_to(slot.target + slot.opening / 2 * slot.across, approach=slot.out).depth
        except InputError:
            wanted = "so small that the walls begin in tissue, as cleft.target_mm does"
            raise InputError("cleft.opening_mm", self.shown("opening"), wanted) from None


@dataclass(frozen=True, kw_only=True)
class Blade(Section):
    """What opens the cleft: kind, width, rounding of its edges, height of its tip above the cleft's floor, thickness (m).

    kind        spatula: one, pushes one wall; two spatulas: push both, half of the way each; tube: widens between both walls
    width       along the walls; of a tube, the width of the wall over which pressure is read
    tip_width   of a spatula that widens from its tip to the surface (m)
    bend        radius (m) of a spatula's face that bulges towards the tissue
    friction    coefficient of Coulomb's friction between blade and tissue
    """

    kind: str = choice("kind", "spatula", ["spatula", "two spatulas", "tube"])
    width: float = number("width_mm", 10e-3)
    edge_radius: float = number("edge_radius_mm", 2e-3, least=1.0)
    tip: float = number("tip_mm", 4e-3)
    thickness: float = number("thickness_mm", 4e-3)
    tip_width: float | None = number("tip_width_mm", None)
    bend: float | None = number("bend_radius_mm", None)
    friction: float = number("friction", 0.0, least=0.0)

    def _check(self, path: str, scene: Scene) -> None:
        wanted = f"at most {scene.cleft.shown('width'):g}, cleft.width_mm: not a blade wider than the cleft"
        self._need(self.width <= scene.cleft.width, path, "width", wanted)
        wanted = f"at most {scene.cleft.shown('opening'):g}, cleft.opening_mm: not a blade thicker than the cleft"
        self._need(self.thickness <= scene.cleft.opening, path, "thickness", wanted)
        least = f"at least {1e3 * NARROWEST:g}, and twice blade.edge_radius_mm = {self.shown('edge_radius'):g}"
        self._need(self.width >= max(NARROWEST, 2 * self.edge_radius), path, "width", least)
        self._need(
            self.friction <= 1, path, "friction", "at most 1: the largest tangential force over the normal force"
        )
        if self.kind == "tube":
            self._check_tube(path, scene)
        else:
            fits = self.tip_width is None or max(NARROWEST, 2 * self.edge_radius) <= self.tip_width <= self.width
            wanted = f"{least}, and at most {self.shown('width'):g}, blade.width_mm"
            self._need(fits, path, "tip_width", wanted)

    def _check_tube(self, path: str, scene: Scene) -> None:
        for name in ("tip_width", "bend"):
            self._need(getattr(self, name) is None, path, name, "this key left out: a tube has no face")
        cleft, opening = scene.cleft, scene.retraction.opening
        wanted = f"at most {cleft.shown('opening') / 2:g}, half of cleft.opening_mm: the tube's radius at first"
        self._need(self.edge_radius <= cleft.opening / 2, path, "edge_radius", wanted)
        widest = (
            f"a spatula: a tube of {1e3 * (cleft.opening + opening):g} mm, cleft.opening_mm and retraction.opening_mm"
        )
        wanted = f"{widest} together, does not fit into cleft.width_mm = {cleft.shown('width'):g}"
        self._need(cleft.opening + opening <= cleft.width, path, "kind", wanted)

    def _check_wall(self, path: str, wall: float) -> None:
        wanted = f"{1e3 * FACED:g} or more below {1e3 * wall:.4g}, the height of the wall over cleft.target_mm"
        self._need(self.tip + FACED <= wall, path, "tip", wanted)
        wanted = f"at least {1e3 * wall:.4g}, the height of the wall over cleft.target_mm"
        self._need(self.bend is None or self.bend >= wall, path, "bend", wanted)


@dataclass(frozen=True, kw_only=True)
class Steps(Section):
    """Longest time step (s) while the blade pushes and while it rests; shorter ones where their error asks for it.

    tolerance   of a step's error: of the overstress of relaxing tissue, against that of two half steps
    """

    contact: float = number("contact_s", 1.0)
    longest: float = number("longest_s", 60.0)
    tolerance: float = number("tolerance", 0.01)

    def _check(self, path: str, scene: Scene) -> None:
        self._need(1e-6 <= self.tolerance <= 0.1, path, "tolerance", "a relative error of 1e-6 to 0.1")
        for name in ("contact", "longest"):
            self._need(getattr(self, name) >= scene.retraction.moment, path, name, scene.retraction.not_shorter)


@dataclass(frozen=True, kw_only=True)
class Patient(Section):
    """Pressures of the patient (mmHg): mean arterial and intracranial. Without the first, nothing is said on perfusion."""

    map_mmHg: float | None = number("map_mmHg", None)  # noqa: N815
    icp_mmHg: float | None = number("icp_mmHg", None, least=0.0)  # noqa: N815

    def _check(self, path: str, scene: Scene) -> None:
        arterial, intracranial = self.map_mmHg, self.icp_mmHg
        self._need(arterial is None or 20 <= arterial <= 300, path, "map_mmHg", "a pressure of 20 to 300 mmHg")
        self._need(intracranial is None or arterial is not None, path, "icp_mmHg", "a value only with patient.map_mmHg")
        wanted = f"less than patient.map_mmHg, {arterial or 0:g}"
        self._need(intracranial is None or intracranial < (arterial or 0), path, "icp_mmHg", wanted)


def _protocols() -> tuple[Protocol, ...]:
    staged = Protocol(kind="staged", stages=5, rest=30.0)
    return Protocol(kind="continuous"), Protocol(kind="intermittent", hold=230.0, rest=90.0), staged


@dataclass(frozen=True, kw_only=True)
class Scene(Document):
    """One operation on one head. Whatever is wrong with one raises `InputError`.

    >>> scene = Scene.shipped("idealised")
    >>> scene.blade.width, scene.to_dict()["blade"]["width_mm"], [p.name for p in scene.protocols]
    (0.01, 10.0, ['continuous', 'intermittent', 'staged'])
    """

    title: str = text("title", "", "one line of text", lambda raw: True)
    body: Body = table(Body, Body)
    tissues: tuple[Tissue, ...] = table(Tissue, size=0)
    support: Support = table(Support, Support)
    cleft: Cleft = table(Cleft)
    blade: Blade = table(Blade, Blade)
    retraction: Retraction = table(Retraction, Retraction)
    protocols: tuple[Protocol, ...] = table(Protocol, _protocols, size=0)
    steps: Steps = table(Steps, Steps)
    patient: Patient = table(Patient, Patient)
    ask: tuple[Ask, ...] | None = table(Ask, None, size=0)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, entry in entries(self).items():
            one, parts = entry.size == 1, getattr(self, name)
            for i, part in enumerate([parts] if one else parts or (), 1) if entry.table else ():
                part._check(entry.key if one else f"{entry.key}#{i}", self)
        if self.body.head == "idealised":  # a scan has to be read first
            self.check_on(Ellipsoids())
        self._check_unique("tissue", self.tissues, "region", [tissue.region for tissue in self.tissues])
        asks = self.ask or ()
        self._check_unique("ask", asks, "quantity", [ask.name for ask in asks])
        self._check_unique("protocol", self.protocols, "name", [_as_file(protocol.name) for protocol in self.protocols])

    def check_on(self, head: Openable) -> None:
        """Raise `InputError` for a cleft, blade or protocol that does not fit into a head."""
        wall = self.cleft.wall(head)
        self.blade._check_wall("blade", wall)
        self.retraction._check_wall("retraction", wall)
        for i, protocol in enumerate(self.protocols, 1):
            protocol._check_wall(f"protocol#{i}", wall)

    @property
    def warnings(self) -> list[str]:
        """What is assumed of the tissues, and what to know of their constants, a line each."""
        found = [
            f"tissue#{i} ({tissue.region}): {caution}"
            for i, tissue in enumerate(self.tissues, 1)
            for caution in tissue.cautions
        ]
        if self.body.shear_modulus_map:
            found.append(
                "body.shear_modulus_map is relative: where it is 1.1 times its mean over a tissue, that tissue's moduli are 1.1 "
                "times what the scene says; its own level, measured with fast and small strains, is not used"
            )
        if not any(tissue.law().branches for tissue in self.tissues):
            found.append("no tissue relaxes: pressures do not fall while the blade holds")
        return found

    @staticmethod
    def _check_unique(key: str, parts: tuple[Section, ...], name: str, values: list[str]) -> None:
        for i, part in enumerate(parts):
            part._need(values[i] not in values[:i], f"{key}#{i + 1}", name, "one that is not used before")

    @classmethod
    def shipped(cls, name: str) -> Scene:
        """One that comes with the package: "demo" (a real head), "idealised", or a coarser "demo_fast", "idealised_fast"."""
        files = _shipped()
        if name not in files:
            raise InputError("scene", brief(name), nearest(str(name), list(files)))
        with resources.as_file(files[name]) as path:
            return cls.from_toml(path)

    @staticmethod
    def template() -> str:
        """The text of a file to start from: "demo", with every key that there is explained."""
        return _shipped()["demo"].read_text(encoding="utf-8")


def _shipped() -> dict[str, Traversable]:
    """Scenes that come with the package, by name."""
    files = resources.files("ngbrain.scenes").iterdir()
    return {Path(file.name).stem: file for file in files if file.name.endswith(".toml")}


def _as_file(name: str) -> str:
    """The same for names that some file systems take for one: capitals or not, the spelling of accents."""
    return unicodedata.normalize("NFKC", name).casefold()
