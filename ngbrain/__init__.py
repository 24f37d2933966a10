"""In silico brain surgery on NGSolve: from a head to a retraction and its risk.

>>> import ngbrain
>>> scene = ngbrain.Scene.shipped("idealised")
>>> scene.retraction.opening
0.005
"""

from importlib.metadata import version
from typing import Any

from ngbrain import ladder
from ngbrain.scene import Scene
from ngbrain.scene.loading import Loading
from ngbrain.surgery import retraction
from ngbrain.threads import set_threads

__version__ = version("ngbrain")

__all__ = ["Loading", "Scene", "__version__", "set_threads", "solve"]


def solve(scene: Scene | Loading, *args: Any, **kwargs: Any) -> dict[str, Any]:
    """What a scene asks for: see `ngbrain.surgery.retraction.solve` for operations, `ngbrain.ladder.solve` for bodies under loads.

    An operation is computed as it is described. A `Loading` says how accurate its answers have to be, and gets the cheapest model
    that is; `model=` fixes it by hand.
    """
    if isinstance(scene, Loading):
        return ladder.solve(scene, *args, **kwargs)
    return retraction.solve(scene, *args, **kwargs)
