"""What the sample case of `ngbrain twin` needs: a map of |G*| of the idealised head with its error; and the norm of the brain.

The map is synthetic: the norm of each tissue times a smooth pattern of one imagined person (a stiffer side, a softer front),
blurred over 4 mm, with seeded errors of 6 % that are alike over 8 mm. `norm` prints those of `ngbrain/samples/norm_brain.toml`:
geometric means of the mean maps of 134 adults over grey and white matter of the MNI152 template.

    python benchmarks/_twin_samples.py map [-o DIR]                        DIR is ngbrain/samples by default
    python benchmarks/_twin_samples.py norm STIFFNESS.nii.zip DAMPING.nii.zip      (`ngbrain data mre134`)
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from scipy import ndimage

import ngbrain as nb
from ngbrain.image import GREY, WHITE, Volume, label_tissues, mni152, write_nifti
from ngbrain.inverse import read_stiffness
from ngbrain.surgery import Norm

SHIPPED = Path(__file__).parents[1] / "ngbrain" / "samples"
VOXEL, BLUR, SD, ALIKE, SEED = 4e-3, 4e-3, 0.06, 8e-3, 20261128


def maps() -> tuple[Volume, Volume]:
    """|G*| (Pa) and its standard deviation, 0 outside of tissue."""
    head = nb.mesh.geometry.primitives
    half = np.ceil((head.SEMI_AXES + VOXEL) / VOXEL) * VOXEL
    shape = np.rint(2 * half / VOXEL).astype(int) + 1
    affine = np.diag([VOXEL, VOXEL, VOXEL, 1.0])
    affine[:3, 3] = -half
    x = np.stack(
        np.meshgrid(*(np.arange(n) * VOXEL - h for n, h in zip(shape, half, strict=True)), indexing="ij"), axis=-1
    )

    def inside(axes: np.ndarray, centre: np.ndarray | float = 0.0) -> np.ndarray:
        return (((x - centre) / axes) ** 2).sum(axis=-1) <= 1

    brain, core = inside(head.SEMI_AXES), inside(head.SEMI_AXES - head.CORTEX_THICKNESS)
    sided = x * [-1.0, 1.0, 1.0]
    fluid = inside(head.VENTRICLE_SEMI_AXES, head.VENTRICLE_CENTRE) | (
        (((sided - head.VENTRICLE_CENTRE) / head.VENTRICLE_SEMI_AXES) ** 2).sum(axis=-1) <= 1
    )
    norm = Norm.named("brain")
    moduli = {name: norm.tissue(name).modulus_at_frequency(50.0) for name in ("cortex", "white")}  # type: ignore[union-attr]
    person = 0.9 * (1 + 0.25 * np.tanh(x[..., 0] / 0.04)) * (1 - 0.2 * np.exp(-(((x[..., 1] - 0.05) / 0.03) ** 2)))
    truth = np.where(core, moduli["white"], moduli["cortex"]) * person
    known = (brain & ~fluid).astype(float)
    blurred = ndimage.gaussian_filter(truth * known, BLUR / VOXEL) / np.maximum(
        ndimage.gaussian_filter(known, BLUR / VOXEL), 1e-9
    )
    off = ndimage.gaussian_filter(np.random.default_rng(SEED).normal(size=tuple(shape)), ALIKE / VOXEL)
    found = np.rint(blurred * np.exp(SD * off / off.std())) * known
    return Volume(found.astype(np.int16), affine), Volume(np.rint(SD * found).astype(np.int16), affine)


def print_norm(stiffness: str, damping: str) -> None:
    """Geometric means of |G*| (Pa) and mean loss tangents over grey and white matter."""
    labels, found = label_tissues(mni152()).volume, read_stiffness(stiffness, damping)
    modulus = found.modulus
    points = found.stiffness.to_world(np.indices(modulus.shape).reshape(3, -1).T)
    label = labels.interpolate(points, order=0).reshape(modulus.shape)
    for name, number in (("grey", GREY), ("white", WHITE)):
        inside = modulus[(label == number) & np.isfinite(modulus)]
        mean = np.exp(np.log(np.abs(inside)).mean())
        print(
            f"{name}: {len(inside)} voxels, |G*| {mean:.0f} Pa, loss tangent {(inside.imag / inside.real).mean():.3f}"
        )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=["map", "norm"])
    parser.add_argument("files", nargs="*")
    parser.add_argument("-o", dest="folder", type=Path, default=SHIPPED)
    given = parser.parse_args()
    if given.what == "norm":
        print_norm(*given.files)
    else:
        for name, volume in zip(("twin_stiffness", "twin_stiffness_sd"), maps(), strict=True):
            write_nifti(given.folder / f"{name}.nii.gz", volume)
