"""In silico brain surgery on NGSolve: from a head to a retraction and its risk.

>>> import ngbrain
>>> scene = ngbrain.Scene.shipped("idealised")
>>> scene.tool.travel
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
    from ngbrain.threads import set_threads
    from ngbrain.workflows.cohort import cohort
    from ngbrain.workflows.preview import preview
    from ngbrain.workflows.simulate import simulate

__version__ = version("ngbrain")

__all__ = [
    "LoadPath",
    "Material",
    "Problem",
    "Scene",
    "TimeStepper",
    "__version__",
    "cohort",
    "datasets",
    "preview",
    "set_threads",
    "simulate",
]

_HOME = {
    "LoadPath": "forward.statics.load_path",
    "Material": "forward.common.material",
    "Problem": "forward.solid.problem",
    "Scene": "scene",
    "TimeStepper": "forward.transient.time_stepper",
    "cohort": "workflows.cohort",
    "preview": "workflows.preview",
    "set_threads": "threads",
    "simulate": "workflows.simulate",
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
