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
from ngbrain.surgery import adequate, retraction
from ngbrain.threads import set_threads

__version__ = version("ngbrain")

__all__ = ["Loading", "Scene", "__version__", "set_threads", "solve"]


def solve(scene: Scene | Loading, *args: Any, **kwargs: Any) -> dict[str, Any]:
    """What a scene asks for: see `ngbrain.ladder.solve` for bodies under loads, `ngbrain.surgery.adequate.solve` for operations
    that ask questions, and `ngbrain.surgery.retraction.solve` for those that ask none.

    Questions say how accurate their answers have to be, and get the cheapest model that is; `model=` fixes it by hand. An operation
    without a question is computed as it is described.
    """
    if isinstance(scene, Loading):
        return ladder.solve(scene, *args, **kwargs)
    if scene.ask:
        return adequate.solve(scene, *args, **kwargs)
    return retraction.solve(scene, *args, **kwargs)
