"""Label numbers of other programs."""

from __future__ import annotations

from collections.abc import Mapping

TISSUES = {1: "csf", 2: "grey", 3: "white", 4: "ventricles"}
"""Label numbers that this package writes."""
SPM = {1: "grey", 2: "white", 3: "csf"}
"""Tissue classes c1, c2, c3 of SPM."""
CAT = {1: "csf", 2: "grey", 3: "white", 4: "white"}
"""Tissues in CAT12's p0 images; 4 is white matter hyperintensity."""
FAST = {1: "csf", 2: "grey", 3: "white"}
"""Tissues in the seg and pveseg images of FSL's FAST."""
_DEEP = (9, 10, 11, 12, 13, 17, 18, 26, 27, 28, 48, 49, 50, 51, 52, 53, 54, 58, 59, 60)
FREESURFER = {
    **dict.fromkeys((2, 41, 77, 78, 79, 30, 62, 85), "white"),
    **dict.fromkeys((192, 251, 252, 253, 254, 255), "corpus_callosum"),
    **dict.fromkeys((3, 42), "grey"),
    **dict.fromkeys((4, 5, 14, 15, 31, 43, 44, 63, 72), "ventricles"),
    **dict.fromkeys((7, 8, 46, 47), "cerebellum"),
    16: "brain_stem",
    24: "csf",
    **dict.fromkeys(_DEEP, "deep_grey"),
    80: "white",
    **dict.fromkeys((25, 57, 99), "lesion"),
}
"""Numbers of FreeSurfer's aseg, also used by FastSurfer and SynthSeg; parcellations are in `_PARCELS`."""
_PARCELS = {(1000, 3000): "grey", (11000, 13000): "grey", (3000, 5003): "white", (13000, 15000): "white"}
"""Numbers from, to: aparc and aparc.a2009s, and the white matter under them of wmparc."""
MUSE = {
    **dict.fromkeys((1, 46), "csf"),
    **dict.fromkeys((4, 11, 49, 50, 51, 52), "ventricles"),
    **dict.fromkeys((44, 45, 63, 64, 69, *range(81, 95)), "white"),
    95: "corpus_callosum",
    **dict.fromkeys((38, 39, 40, 41, 71, 72, 73), "cerebellum"),
    **dict.fromkeys((35, 61, 62), "brain_stem"),
    **dict.fromkeys((23, 30, 31, 32, 36, 37, 47, 48, *range(55, 61), 75, 76), "deep_grey"),
    **dict.fromkeys(range(100, 208), "grey"),
}
"""Numbers of MUSE (NiChart, DLMUSE) and of the Neuromorphometrics atlas of SPM and CAT, which it extends."""
SCHEMES: Mapping[str, Mapping[int, str]] = {
    "freesurfer": FREESURFER,
    "synthseg": FREESURFER,
    "muse": MUSE,
    "spm": SPM,
    "cat": CAT,
    "fast": FAST,
    "ngbrain": TISSUES,
}
RECOGNISED = (
    ("freesurfer", {2, 41}, "FreeSurfer, FastSurfer and SynthSeg"),
    ("freesurfer", {5001, 5002}, "FreeSurfer's wmparc"),
    ("muse", {35, 38, 39, 51, 52}, "MUSE and Neuromorphometrics"),
)
"""Schemes that are identified by their numbers: numbers that every whole brain has, and the programs in words. Small numbers have
different meanings in different programs."""


def region_name(number: int, scheme: str) -> str | None:
    """Region of a number.

    Parameters
    ----------
    number : int
        The label.
    scheme : str
        A key of `SCHEMES`.

    Returns
    -------
    str or None
        None if the scheme has no such number.

    Examples
    --------
    >>> region_name(2035, "freesurfer"), region_name(4, "cat"), region_name(2, "muse")
    ('grey', 'white', None)
    """
    if SCHEMES[scheme] is FREESURFER:
        for (first, end), name in _PARCELS.items():
            if first <= number < end:
                return name
    return SCHEMES[scheme].get(number)


def recognise_scheme(numbers: set[int]) -> tuple[str, str] | None:
    """The only scheme that the numbers of a whole brain can belong to, and its programs in words; None if there is none.

    >>> recognise_scheme({2, 41, 4, 43, 1035, 2035}), recognise_scheme({1, 2, 3})
    (('freesurfer', 'FreeSurfer, FastSurfer and SynthSeg'), None)
    """
    for scheme, needed, whose in RECOGNISED:
        if needed <= numbers and not unknown_numbers(numbers, scheme):
            return scheme, whose
    return None


def unknown_numbers(numbers: set[int], scheme: str) -> list[int]:
    """Numbers that a scheme does not have, sorted.

    Parameters
    ----------
    numbers : set of int
        The labels.
    scheme : str
        A key of `SCHEMES`.

    Returns
    -------
    list of int
    """
    return sorted(number for number in numbers if region_name(number, scheme) is None)


def scheme_choices(numbers: set[int]) -> str:
    """Schemes that numbers may belong to, with the meaning of each number; the other schemes by name."""
    fitting: dict[str, list[str]] = {}
    for scheme in SCHEMES:
        if not unknown_numbers(numbers, scheme) and scheme not in ("freesurfer", "synthseg", "muse"):
            text = ", ".join(f"{number} {region_name(number, scheme)}" for number in sorted(numbers))
            fitting.setdefault(text, []).append(scheme)
    fitting_texts = [f"{' or '.join(names)} ({text})" for text, names in fitting.items()]
    rest = [scheme for scheme in SCHEMES if scheme not in {name for names in fitting.values() for name in names}]
    return ", ".join([*fitting_texts, *rest])
