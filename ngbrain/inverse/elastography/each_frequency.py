"""Each frequency of wave data inverted by itself: moduli at that frequency, without a dispersion law."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from ngbrain import parallel
from ngbrain.inverse.elastography.invert import invert
from ngbrain.inverse.elastography.result import Inversion
from ngbrain.inverse.optimise.result import Iteration
from ngbrain.io.waves import WaveData
from ngbrain.progress import log_progress, reporting


@reporting()
def invert_each_frequency(
    data: WaveData,
    *,
    executor: parallel.AnyExecutor = None,
    callback: Callable[[Iteration], None] = log_progress,
    **how: Any,
) -> dict[float, Inversion]:
    """Invert wave data frequency by frequency, in the plane or in space.

    Where moduli follow a law of frequency, `invert` takes all frequencies at once and determines them better.

    Parameters
    ----------
    data : WaveData
        Waves of several frequencies.
    executor : int or executor, optional
        Inverts the frequencies, each on one thread (`parallel.run`); by default this process. The result does not depend on it.
    callback : callable
        Is called with each `Iteration`; its phase names the frequency too.
    **how
        Arguments of `invert`, the same for all frequencies.

    Returns
    -------
    dict of float to Inversion
        Frequency (Hz) → inversion of its loads, without the `final_state` that error bars need.

    Raises
    ------
    InputError, SolverError
        As `invert`.

    Examples
    --------
    >>> points = np.array([[x, y] for y in range(12) for x in range(12)]) * 4e-3
    >>> k = 2 * np.pi * np.array([50, 70])[:, None, None] * np.sqrt(1000 / (2500 + 500j))
    >>> waves = WaveData(points, 1e-5 * np.exp(-1j * k * points[:, ::-1]), [50, 70], 1000, "isotropic", "viscoelastic", poisson=0.4)
    >>> found = invert_each_frequency(waves.with_noise(0.01, seed=0), uniform=False, regulariser="smooth", max_iterations=1)
    >>> [(f, bool(abs(np.median(each.maps["storage"]) / 2500 - 1) < 0.05)) for f, each in found.items()]
    [(50.0, True), (70.0, True)]
    """
    tasks = []
    for frequency in np.unique(data.frequency).tolist():
        own = data.frequency == frequency
        one = replace(data, displacement=data.displacement[own], frequency=data.frequency[own])
        tasks.append(parallel.Task(f"{frequency:g} Hz", _invert_frequency, (f"{frequency:g} Hz", one, how)))
    found = parallel.run(tasks, executor, callback=lambda iteration: callback(iteration)).values()
    return dict(zip(np.unique(data.frequency).tolist(), found, strict=True))


def _invert_frequency(name: str, one: WaveData, how: dict[str, Any], *, callback: parallel.Callback) -> Inversion:
    """Without the final state, which belongs to one process."""
    found = invert(
        one, callback=lambda iteration: callback(replace(iteration, phase=f"{name}, {iteration.phase}")), **how
    )
    return replace(found, final_state=None)
