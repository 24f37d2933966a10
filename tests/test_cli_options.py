"""The command line: help and version without delay; the offered names are those of the library."""

import subprocess
import sys
from types import SimpleNamespace

import pytest

import ngbrain
from ngbrain.cli import main
from ngbrain.cli.invert import DISCRETISATIONS, STARTS
from ngbrain.cli.options import common
from ngbrain.image.read.label_schemes import SCHEMES
from ngbrain.inverse.elastography.invert_3d import MAX_ITERATIONS
from ngbrain.inverse.objective.misfit import MISFITS
from ngbrain.inverse.objective.regularisers import PRIORS
from ngbrain.inverse.optimise.weight_selection import WEIGHTINGS, WeightSelection
from ngbrain.inverse.problem.properties import UNKNOWNS
from ngbrain.mesh.routes.registry import ROUTES
from ngbrain.solvers.device import DEVICES
from ngbrain.surgery.calibrate import SPREAD
from ngbrain.units import UNITS_OF_LENGTH

VERBS = ("demo", "simulate", "mesh", "invert", "predict", "calibrate", "cohort")


def test_names_are_those_of_the_library():
    assert tuple(DISCRETISATIONS) == common.DISCRETISATIONS and tuple(STARTS) == common.STARTS
    assert tuple(MISFITS) == common.MISFITS and tuple(PRIORS) == common.PRIORS
    assert tuple(UNKNOWNS) == common.UNKNOWNS and tuple(WEIGHTINGS) == common.WEIGHTINGS
    assert tuple(SCHEMES) == common.SCHEMES and tuple(UNITS_OF_LENGTH) == common.UNITS
    assert tuple(ROUTES) == common.ROUTES and tuple(DEVICES) == common.DEVICES and SPREAD == common.SPREAD


def test_rounds_are_those_of_the_library():
    shown = " ".join(common.parsers()["invert"].format_help().split())
    assert f"({WeightSelection().max_iterations} in the plane, {MAX_ITERATIONS} in space)" in shown


def test_nothing_heavy_is_imported_for_help():
    code = "\n".join(
        (
            "import contextlib, io, sys",
            "from ngbrain.cli import main",
            "for verb in sys.argv[1:]:",
            "    with contextlib.suppress(SystemExit), contextlib.redirect_stdout(io.StringIO()):",
            "        main([verb, '--help'])",
            "print(*{'numpy', 'scipy', 'ngsolve', 'matplotlib'} & set(sys.modules))",
        )
    )
    done = subprocess.run([sys.executable, "-c", code, *VERBS], capture_output=True, text=True, check=True)
    assert done.stdout == "\n" and not done.stderr


def test_without_a_verb_there_is_help(capsys):
    assert main([]) == 0
    shown = capsys.readouterr().out
    assert all(verb in shown for verb in VERBS)


def test_version(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["--version"])
    assert ended.value.code == 0 and capsys.readouterr().out == f"ngbrain {ngbrain.__version__}\n"


def test_a_mesh_is_made_on_one_thread(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["mesh", "t1.nii.gz", "--threads", "2"])
    assert ended.value.code == 2 and "--threads" in capsys.readouterr().err


def test_modules_of_the_package_are_found_by_name():
    code = "import ngbrain; print(ngbrain.materials.NeoHooke.__name__, ngbrain.Scene.__name__); ngbrain.no_such_module"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout == "NeoHooke Scene\n"
    assert done.stderr.splitlines()[-1] == "AttributeError: module 'ngbrain' has no attribute 'no_such_module'"


def test_out_of_memory_is_one_line(capsys, monkeypatch):
    def run(_):
        raise MemoryError

    monkeypatch.setattr("ngbrain.cli.import_module", lambda _: SimpleNamespace(run=run))
    assert main(["simulate", "scene.toml"]) == 3
    assert capsys.readouterr().err == "ngbrain: out of memory; larger elements or fewer --threads take less\n"
