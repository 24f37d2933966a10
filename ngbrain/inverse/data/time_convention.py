"""Whether waves lose energy, as tissue requires; in the time convention e^{-iωt} they seem to gain it."""

from __future__ import annotations

from ngbrain.errors import InputError, NgbrainError
from ngbrain.inverse.data.direct_inversion import loss_tangent
from ngbrain.io.waves import WaveData

GAINING, SURE = -0.03, 4.0
"""Loss tangent below which waves gain energy, and the number of standard errors by which it has to be below 0."""


def check_passive(data: WaveData) -> None:
    """Raise `InputError` about waves that gain energy: another time convention, or phase images in reverse order.

    Elastic and quasi-static data are not checked.

    Examples
    --------
    >>> import numpy as np
    >>> grid = np.array([[x, y] for y in range(16) for x in range(16)]) * 3e-3
    >>> k = 2 * np.pi * 60 * np.sqrt(1000 / (2500 + 500j))
    >>> u = 1e-5 * np.stack([np.exp(-1j * k * grid[:, 1]), np.exp(-1j * k * grid[:, 0])], axis=1)[None]
    >>> data = WaveData(grid, u, [60.0], 1000.0, "isotropic", "viscoelastic", poisson=0.4)
    >>> check_passive(data)
    >>> check_passive(data.conjugate())
    Traceback (most recent call last):
    ngbrain.errors.InputError: displacement is of waves that gain energy, G''/G' = -0.2; wanted: u of Re(u e^{+iωt}), ...
    """
    if data.rheology != "viscoelastic":
        return
    try:
        tangent, error = loss_tangent(data)
    except NgbrainError:  # too few points for a smooth field
        return
    if tangent < GAINING and tangent < -SURE * error:
        wanted = (
            "u of Re(u e^{+iωt}), which loses it in tissue: where phase images are in reverse order, or the convention is "
            "e^{-iωt}, conjugate the data (--conjugate, or the key conjugate = true)"
        )
        raise InputError("displacement", f"of waves that gain energy, G''/G' = {tangent:.2g}", wanted)
