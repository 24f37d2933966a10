"""In silico brain surgery on NGSolve: from a head to a retraction and its risk.

>>> import ngbrain
>>> scene = ngbrain.Scene.shipped("idealised")
>>> scene.retraction.opening
0.005
"""

from importlib.metadata import version

from ngbrain.scene import Scene
from ngbrain.surgery.retraction import solve
from ngbrain.threads import set_threads

__version__ = version("ngbrain")

__all__ = ["Scene", "__version__", "set_threads", "solve"]
