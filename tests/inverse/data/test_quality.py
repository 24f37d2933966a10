"""Octahedral shear strain and its SNR: closed forms, missing components, masked points."""

from dataclasses import replace

import numpy as np
import pytest
from planewaves import RHO, grid, wave_number

from ngbrain.errors import InputError
from ngbrain.inverse.data.quality import STILL, octahedral_shear_strain, strain_snr_mask
from ngbrain.io.waves import WaveData

H, NOISE, SIZE = 2e-3, 0.01, 1e-5


def sheared():
    """A wave that shears along y, and a simple shear at rest: u_x alone, with ∂u_x/∂y = γ."""
    points = grid(14, 14, spacing=H)
    k = wave_number(4000.0)
    u = np.zeros((2, len(points), 2), complex)
    u[0, :, 0] = SIZE * np.exp(-1j * k * points[:, 1])
    u[1, :, 0] = 3e-3 * points[:, 1]
    return WaveData(points, u, [50.0, 0.0], RHO, "isotropic", "elastic", poisson=0.4), SIZE * k.real


def test_of_simple_shear():
    """OSS = √(2/3) γ, its slope by ∂u_x/∂y and by ∂u_y/∂x √(2/3); a travelling wave's mean is 2/π of its peak."""
    data, gamma = sheared()
    found = octahedral_shear_strain(data, NOISE)
    wanted = np.sqrt(2 / 3) * np.array([2 / np.pi * gamma, 3e-3])
    assert found.oss == pytest.approx(np.repeat(wanted[:, None], 196, axis=1), rel=1e-3)
    sigma = NOISE * data.rms[:, 0, 0] / np.sqrt(2)  # of u_x; u_y is still, and has a hundredth of it
    spread = np.sqrt(2 / 3) * np.hypot(1, STILL) * sigma / (np.sqrt(2) * H)
    assert np.median(found.snr, axis=1) == pytest.approx(wanted / spread, rel=2e-3)
    assert not found.note and found.median == pytest.approx(np.median(found.snr))


def test_what_is_not_measured_has_none():
    data, _ = sheared()
    u = data.displacement.copy()
    u[0, 40, 1], u[1, :, 0], u[1, :, 1] = np.nan, np.nan, 1e-6
    found = octahedral_shear_strain(replace(data, displacement=u, mask=np.arange(196) >= 14, dirichlet=None), NOISE)
    assert np.flatnonzero(np.isnan(found.oss[0])).tolist() == [*range(14), 40] and np.isnan(found.oss[1]).all()
    assert found.note == ("no octahedral shear strain (OSS) where a component is never measured: component x of load 2")
    assert found.median > 1
    u[:] = np.nan
    u[:, :, 0] = 1e-6
    alone = replace(data, displacement=u)
    assert (
        octahedral_shear_strain(alone, NOISE).median is None
        and "component y of load 1, " in octahedral_shear_strain(alone, NOISE).note
    )
    with pytest.raises(InputError, match=r"displacement is no octahedral .* wanted: all components"):
        strain_snr_mask(alone, NOISE, 3.0)
    some = {name: getattr(data, name)[::15] for name in ("points", "mask", "dirichlet")}
    few = replace(data, displacement=data.displacement[:1, ::15], frequency=[50.0], **some)
    assert "no smooth field" in octahedral_shear_strain(few, NOISE).note


def test_what_hardly_moves_is_left_out_and_nodes_are_not():
    """Standing waves in half of an image, noise in the rest."""
    points = grid(36, 20, spacing=H)
    x = points[:, 0]
    u = np.zeros((1, 720, 2), complex)
    u[0, :, 1] = SIZE * np.prod(np.cos(2 * np.pi * points / 0.03), axis=1) * np.exp(-((x / 0.03) ** 6))
    data = WaveData(points, u, [50.0], RHO, "isotropic", "elastic", poisson=0.4).with_noise(0.02, seed=0)
    kept, low = strain_snr_mask(data, None, 20.0), octahedral_shear_strain(data, 0.02).snr[0] < 20
    inside = (x > 1e-3) & (x < 0.027) & (np.abs(points[:, 1] - 0.019) < 0.016)
    assert kept[inside].all() and kept[x > 0.041].mean() < 0.02
    assert (inside & low).sum() > 2  # nodes: nothing is strained there
