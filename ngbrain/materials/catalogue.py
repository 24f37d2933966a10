"""Published constants of the tissues of the head, by name: "author year:region", with further parts where needed."""

from __future__ import annotations

import math
import warnings
from dataclasses import KW_ONLY, dataclass
from difflib import SequenceMatcher
from typing import Literal, cast

from ngbrain.errors import InputError, RangeWarning
from ngbrain.look import NotebookCard
from ngbrain.materials.base import Law
from ngbrain.materials.families import RelaxingOgden
from ngbrain.materials.isotropic import Demiray, Gent, NeoHooke, Ogden, Polynomial
from ngbrain.materials.viscous import Prony, Viscous, viscous

ALIKE = 0.6
"""Smallest similarity ratio from which a name is suggested."""
_warned: set[str] = set()


@dataclass(frozen=True, repr=False)
class Published(NotebookCard):
    """A published material with its source and its range of validity.

    Parameters
    ----------
    material : Law or Viscous
        The law with the constants of the source.
    initial_modulus : float
        Shear modulus μ₀ (Pa) at small strain, instantaneous.
    name : str
        Name in the catalogue.
    source : str
        Authors and year.
    doi : str
        DOI of the source.
    species : str
        Species of the samples.
    region : str
        Region of the head.
    protocol : str
        Tests of the samples and their rates.
    stretch : tuple of (float, float)
        Lowest and highest stretch of the data.
    evidence : {'source', 'transcription', 'refit', 'recalled'}
        Origin of the numbers. "source": read in the source; "transcription": read in public code of others;
        "refit": fitted for this package to the curves of the source; "recalled": from memory, to be looked up
        before they are quoted.
    convention : str, default 'as here'
        Symbols of the source where they differ from those of this package.
    note : str, default ''
        Further remarks.
    caution : str, default ''
        Warning that the result of a scene with this material carries.
    bulk : float, optional
        Bulk modulus K (Pa), where the source states one.
    poisson : float, optional
        Poisson's ratio, where the source states one.
    preconditioned : bool, default False
        Whether the samples were preconditioned, which softens them.
    pace : {'sudden', 'slow', 'drained'}, default 'slow'
        Loading rate that an elastic law describes: sudden, slow, or so slow that the fluid has drained.
        Viscoelastic laws cover all.
    """

    material: Law | Viscous
    initial_modulus: float
    _: KW_ONLY
    name: str
    source: str
    doi: str
    species: str
    region: str
    protocol: str
    stretch: tuple[float, float]
    evidence: Literal["source", "transcription", "refit", "recalled"]
    convention: str = "as here"
    note: str = ""
    caution: str = ""
    bulk: float | None = None
    poisson: float | None = None
    preconditioned: bool = False
    pace: Literal["sudden", "slow", "drained"] = "slow"

    PICTURE = "ngbrain.materials.lab.plot:plot_entry"

    def summary(self) -> dict[str, str]:
        """Tissue, law, constants, range of the data and source in words."""
        from ngbrain.materials.lab.description import entry_rows  # it imports this module

        return {"name": self.name} | {name: rows.replace("\n", "; ") for name, rows in entry_rows(self).items()}

    def __repr__(self) -> str:
        rows, (least, most) = self.summary(), self.stretch
        return f"Published: {self.name}; {rows['law']}; stretches {least:g} to {most:g}; DOI {self.doi}"

    def law(self) -> Law | Viscous:
        """The material law."""
        return self.material

    @property
    def fitted_strain(self) -> float:
        """Largest |λ - 1| of the data."""
        return round(max(abs(stretch - 1) for stretch in self.stretch), 9)

    @property
    def principal_stretch(self) -> tuple[float, float]:
        """Lowest and highest principal stretch of the samples: λ along the axis and λ^(-1/2) across it, at constant volume.

        >>> constants("budday2017:cortex:ogden:compression").principal_stretch
        (0.9, 1.0540925533894598)
        """
        least, most = self.stretch
        thin, thick = 1 / math.sqrt(most), 1 / math.sqrt(least) if least else math.inf
        return min(least, thin), max(most, thick)

    @property
    def cautions(self) -> list[str]:
        """Warnings for users of these constants.

        >>> constants("miller1997:brain").cautions
        ['measured in compression alone', 'constants recalled: look them up before you quote them']
        """
        least, most = self.stretch
        found = [self.caution] if self.caution else []
        if least >= 1 or most <= 1:
            found.append(f"measured in {'tension' if least >= 1 else 'compression'} alone")
        if self.evidence == "recalled":
            found.append("constants recalled: look them up before you quote them")
        return found

    def check(self, low: float, high: float) -> None:
        """Warn, once per process, if stretches leave the range of the data.

        Parameters
        ----------
        low, high : float
            Lowest and highest stretch of the computation.
        """
        least, most = self.stretch
        if (low < least - 1e-9 or high > most + 1e-9) and self.name not in _warned:
            _warned.add(self.name)
            met = f"met: {low:.4g} to {high:.4g}"
            warnings.warn(
                f"{self.name} has data for stretches {least:g} to {most:g}; {met}", RangeWarning, stacklevel=2
            )


def _griffiths() -> list[Published]:
    constants = {
        "cortex": ((420.0, 1400.0, 560.0), (-21.27, -14.66, -23.76), (3050.0, 289370.0)),
        "white_matter": ((160.0, 970.0, 250.0), (-25.66, -25.35, -29.22), (2190.0, 299790.0)),
        "corpus_callosum": ((40.0, 630.0, 160.0), (-28.41, -27.01, -30.8), (1620.0, 232530.0)),
        "deep_grey": ((170.0, 680.0, 270.0), (-21.52, -15.5, -22.76), (2270.0, 240170.0)),
    }
    return [
        Published(
            RelaxingOgden(mu, alpha, eta),
            sum(mu),
            name=f"griffiths2024:{region}",
            source="Griffiths, Jayamohan, Budday 2024",
            doi="10.1007/s10237-023-01806-2",
            species="human",
            region=region,
            protocol="compression, tension, shear and relaxation, ex vivo",
            stretch=(0.9, 1.1),
            evidence="source",
            note="from the authors' parameter files (*_med.prm); finite viscoelasticity, there as here",
            poisson=0.49,
        )
        for region, (mu, alpha, eta) in constants.items()
    ]


_BUDDAY_REFITS = {
    "cortex": (1442.0, -19.2),
    "corona_radiata": (624.0, -23.5),
    "basal_ganglia": (687.0, -18.2),
    "corpus_callosum": (348.0, -23.3),
}
# Moduli in Pa; each law's constants in compression, then in tension.
_BUDDAY_ONE_MODE: dict[str, dict[type, tuple[tuple[float, ...], tuple[float, ...]]]] = {
    "cortex": {
        Ogden: ((1610.0, -16.6), (1200.0, -43.6)),
        NeoHooke: ((2800.0,), (1220.0,)),
        Demiray: ((1900.0, 18.8), (910.0, 16.7)),
        Gent: ((2010.0, 0.08), (920.0, 0.08)),
    },
    "corona_radiata": {
        Ogden: ((850.0, -20.5), (610.0, -30.5)),
        NeoHooke: ((1750.0,), (520.0,)),
        Demiray: ((1050.0, 24.6), (480.0, 4.37)),
        Gent: ((1160.0, 0.06), (480.0, 0.23)),
    },
    "basal_ganglia": {
        Ogden: ((830.0, -15.5), (650.0, -32.5)),
        NeoHooke: ((1370.0,), (570.0,)),
        Demiray: ((970.0, 17.1), (520.0, 6.03)),
        Gent: ((1010.0, 0.08), (520.0, 0.18)),
    },
    "corpus_callosum": {
        Ogden: ((430.0, -22.8), (350.0, -26.6)),
        NeoHooke: ((990.0,), (290.0,)),
        Demiray: ((550.0, 28.4), (280.0, 1.29)),
        Gent: ((620.0, 0.06), (290.0, 85.0)),
    },
}
_MODES = {"compression": (0.9, 1.0), "tension": (1.0, 1.1)}


def _budday() -> list[Published]:
    source, doi = "Budday et al. 2017", "10.1016/j.actbio.2016.10.036"
    samples = "5 mm cubes, less than 24 h after death, conditioned, quasi-static"
    found = [
        Published(
            Ogden(mu, alpha),
            mu,
            name=f"budday2017:{region}",
            source=source,
            doi=doi,
            species="human",
            region=region,
            protocol=f"{samples}: compression, tension and simple shear to 0.2",
            stretch=(0.9, 1.1),
            evidence="refit",
            preconditioned=True,
            note="one fit to the averaged curves of all three modes, each scaled by its peak",
        )
        for region, (mu, alpha) in _BUDDAY_REFITS.items()
    ]
    for region, laws in _BUDDAY_ONE_MODE.items():
        for law, values in laws.items():
            for (mode, stretch), constants in zip(_MODES.items(), values, strict=True):
                locks = f"the energy is undefined beyond I₁ = {3 + constants[1]:g}" if law is Gent else ""
                found.append(
                    Published(
                        law(*constants),
                        constants[0],
                        name=f"budday2017:{region}:{law.__name__.lower()}:{mode}",
                        source=source,
                        doi=doi,
                        species="human",
                        region=region,
                        protocol=f"{samples}: {mode}",
                        stretch=stretch,
                        evidence="transcription",
                        preconditioned=True,
                        note=f"fits {mode} alone",
                        caution=locks,
                    )
                )
    return found


# Both have the same relaxation; W is the instantaneous law.
_MILLER = {"g": [0.450, 0.365], "tau": [0.5, 50.0]}
_MILLER_RATES = "cylinders in vitro, strain rates 0.64 to 0.64e-5 /s"


def _soft() -> list[Published]:
    return [
        Published(
            Prony(Polynomial({(1, 0): 263.0, (0, 1): 263.0, (2, 0): 491.0, (0, 2): 491.0}), **_MILLER),
            1052.0,
            name="miller1997:brain",
            source="Miller & Chinzei 1997",
            doi="10.1016/S0021-9290(97)00092-4",
            species="swine",
            region="brain",
            protocol=f"unconfined compression of {_MILLER_RATES}",
            stretch=(0.7, 1.0),
            evidence="recalled",
        ),
        Published(
            Prony(Ogden(842.0, -4.7), **_MILLER),
            842.0,
            name="miller2002:brain",
            source="Miller & Chinzei 2002",
            doi="10.1016/S0021-9290(01)00234-2",
            species="swine",
            region="brain",
            protocol=f"tension and compression of {_MILLER_RATES}",
            stretch=(0.7, 1.3),
            evidence="recalled",
            note="μ and α are in a transcription, whose own law however has half the stiffness; g and τ are recalled",
        ),
        Published(
            Polynomial({(1, 0): -1010.0, (0, 1): 1490.0, (1, 1): 190.0}),
            960.0,
            name="laksari2012:brain",
            source="Laksari, Shafieian, Darvish 2012",
            doi="10.1016/j.jbiomech.2011.12.023",
            species="bovine",
            region="brain",
            protocol="compression, ex vivo",
            stretch=(0.7, 1.0),
            evidence="transcription",
            note="incompressible; DOI and range recalled",
            pace="sudden",
            caution="instantaneous law only; c₁₀ < 0: not stable in every deformation",
        ),
        Published(
            # μ/α of the source is 2μ/α² here.
            Ogden([1044.0 * 4.309 / 2, 1183.0 * 7.736 / 2], [4.309, 7.736]),
            6825.142,
            name="franceschini2006:brain",
            source="Franceschini, Bigoni, Regitnig, Holzapfel 2006",
            doi="10.1016/j.jmps.2006.05.004",
            species="human",
            region="brain",
            protocol="slow uniaxial cycles and drained consolidation, ex vivo",
            stretch=(0.9, 1.1),
            evidence="transcription",
            convention="W = Σ μ/α (Σ λ^α - 3) with μ = 1044, 1183 Pa, α = 4.309, 7.736; initial shear modulus Σ μα/2",
            note="the range is a cautious guess, DOI recalled",
            pace="drained",
            caution="the drained solid skeleton, without the fluid that carries fast loads",
        ),
        Published(
            Ogden(670.0, -19.0),
            670.0,
            name="bennion2022:brain",
            source="Bennion et al. 2022 (PMC9748497)",
            doi="10.1098/rsif.2022.0557",
            species="human",
            region="brain",
            protocol="in vivo: the brain's shift between prone and supine, quasi-static",
            stretch=(0.95, 1.05),
            evidence="source",
            convention="μ taken for the initial shear modulus; were it FEBio's own coefficient, that would be 335 Pa",
            note="μ, α, K from the abstract; the range is a cautious guess, DOI recalled",
            bulk=148e3,
        ),
        Published(
            NeoHooke(10.0 / 2.2),
            10.0 / 2.2,
            name="wittek2007:csf",
            source="Wittek, Miller, Kikinis, Warfield 2007",
            doi="10.1016/j.jbiomech.2006.02.021",
            species="none",
            region="ventricles",
            protocol="none: a very soft solid in place of a fluid that can drain",
            stretch=(0.0, math.inf),
            evidence="recalled",
            convention="E = 10 Pa",
            bulk=10.0 / 2.4,
            poisson=0.1,
        ),
    ]


def _stiff() -> list[Published]:
    linear = "linear elasticity by Young's modulus; for small strain only"
    small = "a linear law for small strain, used as Neo-Hookean"
    return [
        Published(
            NeoHooke(68.1e6 / 3),
            22.7e6,
            name="pearcy2022:dura",
            source="Pearcy et al. 2022, a meta-analysis of 17 studies",
            doi="10.1007/s10237-022-01566-5",
            species="human",
            region="cranial dura mater",
            protocol="mostly uniaxial tension at 10 to 20 mm/min, ex vivo",
            stretch=(1.0, 1.144),
            evidence="source",
            convention=f"{linear}; E = 68.1 MPa, here incompressible",
            caution=small,
            note="14.4 % is the mean strain at rupture; head models often have 31.5 MPa (Galford & McElhaney 1970)",
        ),
        Published(
            NeoHooke(7.7e6 / 3),
            7.7e6 / 3,
            name="conley2020:pia_arachnoid",
            source="Conley Natividad et al. 2020",
            doi="10.1186/s12987-020-00229-w",
            species="ovine",
            region="pia-arachnoid complex",
            protocol="uniaxial tension at 0.59 /s to failure, ex vivo",
            stretch=(1.0, 1.6),
            evidence="source",
            convention=f"{linear}; E = 7.7 MPa, here incompressible",
            caution=small,
        ),
        Published(
            NeoHooke(1.2e6 / 3),
            0.4e6,
            name="bennion2022:pia",
            source="Bennion et al. 2022 (PMC9748497)",
            doi="10.1098/rsif.2022.0557",
            species="human",
            region="pia mater",
            protocol="in vivo: the brain's shift between prone and supine, quasi-static",
            stretch=(0.95, 1.05),
            evidence="source",
            convention=f"{linear}; stiffness 1.2 MPa taken for E, here incompressible",
            caution=small,
            note="from the abstract; the range is a cautious guess, DOI recalled",
        ),
        Published(
            NeoHooke(5.6e9 / 2.44),
            5.6e9 / 2.44,
            name="mcelhaney1970:skull",
            source="McElhaney et al. 1970",
            doi="10.1016/0021-9290(70)90059-X",
            species="human",
            region="skull, all layers",
            protocol="quasi-static compression along the surface",
            stretch=(0.99, 1.01),
            evidence="recalled",
            convention=f"{linear}; E = 5.6 GPa, ν = 0.22",
            caution=small,
            note="across the skull about half as stiff; the range is a cautious guess",
            bulk=5.6e9 / 1.68,
            poisson=0.22,
        ),
    ]


CATALOGUE: dict[str, Published] = {e.name: e for e in _griffiths() + _budday() + _soft() + _stiff()}


def suggest(name: str) -> str:
    """Suggestions for an unknown name: entries that contain it, or the most similar ones.

    >>> suggest("miler2002:brain")
    "a name in the catalogue, such as 'miller2002:brain', 'miller1997:brain', 'laksari2012:brain'; `ngbrain materials` lists all"
    """

    def likeness(known: str) -> float:
        """Similarity of the whole name, or of a part between colons."""
        parts = (known, *known.split(":"))
        return max(SequenceMatcher(None, name.casefold(), part).ratio() for part in parts) + (name.casefold() in known)

    near = sorted((known for known in CATALOGUE if likeness(known) >= ALIKE), key=likeness, reverse=True)
    such = ", such as " + ", ".join(map(repr, near[:3])) if name and near else ""
    return f"a name in the catalogue{such}; `ngbrain materials` lists all"


def constants(name: str) -> Published:
    """The published constants of a name, for example "griffiths2024:cortex"; raises `InputError` for an unknown name.

    >>> constants("miller2002:brain").initial_modulus
    842.0
    """
    if name not in CATALOGUE:
        raise InputError("constants", repr(name), suggest(name))
    return CATALOGUE[name]


def find_entry(law: object) -> Published | None:
    """The catalogue entry whose law equals this one, or None.

    >>> find_entry(Ogden(670.0, -19.0)).name
    'bennion2022:brain'
    """
    wanted = viscous(cast(Law, law))
    return next((entry for entry in CATALOGUE.values() if viscous(entry.law()) == wanted), None)
