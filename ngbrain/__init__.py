"""In silico brain surgery on NGSolve: from a scan to a mesh, from waves to tissue properties, and from both to a retraction.

>>> import ngbrain as nb
>>> scene = nb.Scene.shipped("idealised")
>>> scene.tool.travel
0.005

What do you have?

- a T1 or labels: `nb.mesh_head("t1.nii.gz", "head.vtkhdf")`; step by step `nb.read_scan`, `nb.segment`
- waves or strain images: `nb.invert(nb.read_waves("waves.npz"))`; in hundredths of a second `nb.predict`
- a scene (TOML): `nb.simulate("scene.toml", "out")`, drawn first by `nb.preview`; what was seen in surgery: `nb.calibrate`
- many of these: `nb.cohort`
- an energy of your own: `nb.Problem` of `nb.Material`, driven by `nb.LoadPath`, `nb.TimeStepper` or, for waves,
  `nb.HarmonicProblem`; its parameters from data: `nb.estimate`

Packages, each with its table of contents in `help`:

- `nb.materials`: energies, the catalogue of published constants, tests of a specimen
- `nb.image`, `nb.mesh`: scans, labels, meshes
- `nb.forward`: the one nonlinear solid, statics, waves, time; observables and derivatives
- `nb.inverse`: elastography, optimisers, uncertainty
- `nb.scene`, `nb.surgery`, `nb.ladder`: jobs, operations, the cheapest adequate model
- `nb.io`, `nb.datasets`, `nb.units`, `nb.viz`, `nb.errors`: files, sample data, units, pictures, exceptions

Lengths are m, stresses Pa, times s inside; `nb.units` has kPa, mm, mmHg. Long work logs to `logging.getLogger("ngbrain")`.
`nb.set_threads` sets threads at run time; `nb.show_versions()` prints what a report of a fault needs.
"""

from importlib import import_module
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ngbrain import (
        datasets,
        errors,
        forward,
        image,
        inverse,
        io,
        ladder,
        materials,
        mesh,
        scene,
        surgery,
        units,
        viz,
    )
    from ngbrain.forward.common.material import Material
    from ngbrain.forward.harmonic.problem import HarmonicProblem
    from ngbrain.forward.solid.problem import Problem
    from ngbrain.forward.statics.load_path import LoadPath
    from ngbrain.forward.transient.time_stepper import TimeStepper
    from ngbrain.image.labelling import label_tissues as segment
    from ngbrain.image.read.volume import read_scan
    from ngbrain.inverse.elastography.invert import invert
    from ngbrain.inverse.fitting.estimate import estimate
    from ngbrain.io.versions import show_versions
    from ngbrain.io.waves import read_waves
    from ngbrain.scene import Scene
    from ngbrain.surgery.calibrate import calibrate
    from ngbrain.surrogate.prediction.predict import predict
    from ngbrain.threads import set_threads
    from ngbrain.workflows.cohort import cohort
    from ngbrain.workflows.mesh_head import mesh_head
    from ngbrain.workflows.preview import preview
    from ngbrain.workflows.simulate import simulate

__version__ = version("ngbrain")

__all__ = [
    "HarmonicProblem",
    "LoadPath",
    "Material",
    "Problem",
    "Scene",
    "TimeStepper",
    "__version__",
    "calibrate",
    "cohort",
    "datasets",
    "errors",
    "estimate",
    "forward",
    "image",
    "inverse",
    "invert",
    "io",
    "ladder",
    "materials",
    "mesh",
    "mesh_head",
    "predict",
    "preview",
    "read_scan",
    "read_waves",
    "scene",
    "segment",
    "set_threads",
    "show_versions",
    "simulate",
    "surgery",
    "units",
    "viz",
]

_HOME = {
    "HarmonicProblem": "forward.harmonic.problem",
    "LoadPath": "forward.statics.load_path",
    "Material": "forward.common.material",
    "Problem": "forward.solid.problem",
    "Scene": "scene",
    "TimeStepper": "forward.transient.time_stepper",
    "calibrate": "surgery.calibrate",
    "cohort": "workflows.cohort",
    "estimate": "inverse.fitting.estimate",
    "invert": "inverse.elastography.invert",
    "mesh_head": "workflows.mesh_head",
    "predict": "surrogate.prediction.predict",
    "preview": "workflows.preview",
    "read_scan": "image.read.volume",
    "read_waves": "io.waves",
    "segment": "image.labelling:label_tissues",
    "set_threads": "threads",
    "show_versions": "io.versions",
    "simulate": "workflows.simulate",
}

if not TYPE_CHECKING:  # who checks types sees the names above and the package's modules, and no others

    def __getattr__(name: str) -> Any:
        """Names and modules of the package, imported when they are first used: all at once they take more than a second."""
        if name in _HOME:
            module, _, own = _HOME[name].partition(":")
            return getattr(import_module(f"ngbrain.{module}"), own or name)
        try:
            return import_module(f"ngbrain.{name}")
        except ModuleNotFoundError as error:
            if error.name != f"ngbrain.{name}":
                raise
            raise AttributeError(f"module 'ngbrain' has no attribute {name!r}") from None

    def __dir__() -> list[str]:
        return sorted(__all__)
