"""In silico brain surgery on NGSolve: from a head to a retraction and its risk.

>>> import ngbrain
>>> scene = ngbrain.Scene.shipped("idealised")
>>> scene.retraction.opening
0.005
"""

from importlib import import_module
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ngbrain import datasets
    from ngbrain.forward.common.material import Material
    from ngbrain.forward.solid.problem import Problem
    from ngbrain.forward.statics.load_path import LoadPath
    from ngbrain.forward.transient.time_stepper import TimeStepper
    from ngbrain.scene import Scene
    from ngbrain.scene.loading import Loading
    from ngbrain.scene.result import SceneResult
    from ngbrain.threads import set_threads
    from ngbrain.workflows.cohort import cohort

__version__ = version("ngbrain")

__all__ = [
    "LoadPath",
    "Loading",
    "Material",
    "Problem",
    "Scene",
    "TimeStepper",
    "__version__",
    "cohort",
    "datasets",
    "set_threads",
    "solve",
]

_HOME = {
    "LoadPath": "forward.statics.load_path",
    "Loading": "scene.loading",
    "Material": "forward.common.material",
    "Problem": "forward.solid.problem",
    "Scene": "scene",
    "TimeStepper": "forward.transient.time_stepper",
    "cohort": "workflows.cohort",
    "set_threads": "threads",
}

if not TYPE_CHECKING:  # who checks types sees the names above and the package's modules, and no others

    def __getattr__(name: str) -> Any:
        """Names and modules of the package, imported when they are first used: all at once they take more than a second."""
        if name in _HOME:
            return getattr(import_module(f"ngbrain.{_HOME[name]}"), name)
        try:
            return import_module(f"ngbrain.{name}")
        except ModuleNotFoundError as error:
            if error.name != f"ngbrain.{name}":
                raise
            raise AttributeError(f"module 'ngbrain' has no attribute {name!r}") from None

    def __dir__() -> list[str]:
        return sorted({*globals(), *__all__})


def solve(scene: "Scene | Loading", *args: Any, **kwargs: Any) -> "SceneResult":
    """What a scene asks for: see `ngbrain.ladder.solve` for bodies under loads, `ngbrain.surgery.adequate.solve` for operations
    that ask questions, and `ngbrain.surgery.retraction.solve` for those that ask none.

    Questions say how accurate their answers have to be, and get the cheapest model that is; `model=` fixes it by hand. An operation
    without a question is computed as it is described.
    """
    from ngbrain import ladder
    from ngbrain.scene.loading import Loading
    from ngbrain.surgery import adequate, retraction

    if isinstance(scene, Loading):
        return ladder.solve(scene, *args, **kwargs)
    if scene.ask:
        return adequate.solve(scene, *args, **kwargs)
    return retraction.solve(scene, *args, **kwargs)
