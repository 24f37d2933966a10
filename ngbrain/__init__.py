"""Brain biomechanics on NGSolve: head meshes from scans, tissue properties from elastography, simulated brain retraction.

>>> import ngbrain as nb
>>> scene = nb.Scene.shipped("idealised")
>>> scene.tool.travel
0.005

Where to begin
--------------
- a T1-weighted scan or a label map: `nb.mesh_head("t1.nii.gz", "head.vtkhdf")` makes a mesh; `nb.read_scan` and `nb.segment`
  are its first steps
- displacements of waves or of a compression: `nb.invert(nb.read_waves("waves.npz"))` estimates property maps; `nb.predict` does
  so in hundredths of a second by a trained neural operator
- a retraction described in a scene file (TOML): `nb.preview` draws it, `nb.simulate("scene.toml", "out")` computes it,
  `nb.calibrate` fits tissue stiffness to measured forces and displacements
- one patient and several surgical plans: `nb.twin` compares them, with what is not known of the tissue carried through
- many subjects: `nb.cohort`
- a boundary-value problem of your own: `nb.Problem` with `nb.Material`, solved by `nb.LoadPath` (quasi-static) or
  `nb.TimeStepper` (transient), and `nb.HarmonicProblem` for waves; `nb.estimate` fits parameters to data

Tutorials are in `tutorials/`, guides and a glossary in `tutorials/guide/`. `help(nb.materials)` and so on list the names
and modules of a package.

Packages
--------
- `nb.materials`: material laws as energy densities, published constants, homogeneous tests and fits
- `nb.image`: reading, preprocessing and segmentation of medical images
- `nb.mesh`: tetrahedral meshes of heads
- `nb.forward`: nonlinear solids in statics, in time and in harmonic motion; contact, observables, sensitivities
- `nb.adjoint`, `nb.solvers`: reduced objectives with checked derivatives; linear and nonlinear solvers
- `nb.inverse`: elastography, parameter estimation, optimisers, uncertainty
- `nb.surrogate`: a neural operator for property maps, and its training
- `nb.scene`, `nb.surgery`: scene files; retraction, measures of tissue injury, uncertainty and calibration
- `nb.ladder`: model selection by estimated model error
- `nb.workflows`, `nb.cli`, `nb.report`: complete jobs, the command line, HTML reports
- `nb.io`, `nb.parallel`, `nb.interop`: files, executors, optimisers and frameworks of other libraries
- `nb.datasets`, `nb.units`, `nb.viz`, `nb.errors`: sample data, units, visualisation, exceptions

Conventions
-----------
Internal units are SI (m, Pa, s); `nb.units` has kPa, mm, mmHg. Long computations show a bar on a terminal and in a notebook, and
log a line every 30 s to `logging.getLogger("ngbrain")`; a function `callback` of your own takes the place of both.
`nb.set_threads` sets the number of threads; `nb.show_versions()` prints what a bug report needs.
"""

from importlib.metadata import version
from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names

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
    from ngbrain.image.read.image_file import read_scan
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
    from ngbrain.workflows.twin import twin
else:
    __getattr__, __dir__ = lazy_names(__name__)

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
    "twin",
    "units",
    "viz",
]
