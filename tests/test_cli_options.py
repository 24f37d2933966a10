"""The command line: help and version without delay; the offered names are those of the library."""

import shlex
import shutil
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest

import ngbrain
from ngbrain.cli import _join_negative_values, main
from ngbrain.cli.invert import DISCRETISATIONS, STARTS
from ngbrain.cli.options import common, help_page
from ngbrain.image.read.label_schemes import SCHEMES
from ngbrain.inverse.elastography.invert_3d import MAX_ITERATIONS
from ngbrain.inverse.objective.misfit import MISFITS
from ngbrain.inverse.objective.regularisers import PRIORS
from ngbrain.inverse.optimise.weight_selection import WEIGHTINGS, WeightSelection
from ngbrain.inverse.problem.properties import UNKNOWNS
from ngbrain.io import exchange
from ngbrain.materials.registry import REGISTRY
from ngbrain.mesh.routes.registry import ROUTES
from ngbrain.solvers.device import DEVICES
from ngbrain.surgery.calibrate import SPREAD
from ngbrain.surgery.observations import Observations
from ngbrain.units import UNITS_OF_LENGTH

VERBS = ("demo", "simulate", "mesh", "invert", "predict", "calibrate", "cohort")


def test_names_are_those_of_the_library():
    assert tuple(DISCRETISATIONS) == common.DISCRETISATIONS and tuple(STARTS) == common.STARTS
    assert tuple(MISFITS) == common.MISFITS and tuple(PRIORS) == common.PRIORS
    assert tuple(UNKNOWNS) == common.UNKNOWNS and tuple(WEIGHTINGS) == common.WEIGHTINGS
    assert tuple(SCHEMES) == common.SCHEMES and tuple(UNITS_OF_LENGTH) == common.UNITS
    assert common.MESH_UNITS == exchange.UNITS
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


# --- help, templates, completion --------------------------------------------------------------------------------------


def test_every_verb_stands_in_one_group_of_the_help(capsys):
    grouped = [verb for verbs in help_page.GROUPS.values() for verb in verbs]
    assert sorted(grouped) == sorted(common.parsers()) == sorted(help_page.EXAMPLES)
    main([])
    shown = capsys.readouterr().out
    places = [shown.index(f"\n{title}:") for title in help_page.GROUPS]
    assert places == sorted(places) and "{demo" not in shown
    for title, verbs in help_page.GROUPS.items():
        section = shown[shown.index(f"\n{title}:") + 1 :].partition("\n\n")[0]
        assert all(f"\n  {verb} " in section for verb in verbs), title


@pytest.mark.parametrize("verb", sorted(help_page.EXAMPLES))
def test_help_ends_with_examples_that_are_commands(verb, capsys):
    parser, shown = common.parser(), common.parsers()[verb].format_help()
    assert 2 <= len(help_page.EXAMPLES[verb]) <= 4
    for example, _ in help_page.EXAMPLES[verb]:
        assert example in shown
        words = shlex.split(example.partition(" >")[0])
        assert words[0] == "ngbrain"
        if "--template" in words:
            with pytest.raises(SystemExit) as ended:
                parser.parse_args(words[1:])
            assert ended.value.code == 0 and capsys.readouterr().out
        else:
            parser.parse_args(_join_negative_values(words[1:]))
    assert shown.rstrip().splitlines()[-1].strip().startswith(help_page.EXAMPLES[verb][-1][0])


def test_verbs_that_read_a_text_file_print_one():
    """All but `mesh`, `demo` (images), `data` and `doctor` (names)."""
    having = {verb for verb, each in common.parsers().items() if "--template" in each._option_string_actions}
    assert having == set(common.parsers()) - {"mesh", "demo", "data", "doctor"}


def printed(capsys, *argv):
    with pytest.raises(SystemExit) as ended:
        main(list(argv))
    assert ended.value.code == 0
    return capsys.readouterr().out


def test_tables_of_calibrate_can_be_read_as_printed(tmp_path, capsys):
    for kind in common.TABLES:
        (tmp_path / f"{kind}.csv").write_text(printed(capsys, "calibrate", "--template", kind))
    seen = Observations.read(tmp_path / "landmarks.csv", tmp_path / "force.csv")
    assert seen.landmarks.shape == (2, 3) and seen.times.tolist() == [2.5, 5.0, 7.5]
    assert np.isnan(seen.displacements).any() and seen.force.tolist() == [0.29, 1.1, 0.88]


def test_a_printed_law_is_a_law(tmp_path, capsys):
    (tmp_path / "my_laws.py").write_text(printed(capsys, "materials", "--template"))
    assert main(["materials", "--laws", str(tmp_path / "my_laws.py")]) == 0
    assert "\nQuartic " in capsys.readouterr().out
    REGISTRY.pop("Quartic")


@pytest.mark.skipif(shutil.which("bash") is None, reason="bash is not installed")
def test_bash_completes_verbs_options_and_files(tmp_path, capsys):
    (tmp_path / "ngbrain.bash").write_text(printed(capsys, "--print-completion", "bash"))
    (tmp_path / "waves.npz").write_text("")

    def complete(*words):
        line = " ".join(f"'{word}'" for word in words)
        script = f'source ngbrain.bash; COMP_WORDS=({line}); COMP_CWORD={len(words) - 1}; _shtab_ngbrain; echo "${{COMPREPLY[@]}}"'
        done = subprocess.run(["bash", "-c", script], cwd=tmp_path, capture_output=True, text=True, check=True)
        return done.stdout.split()

    assert complete("ngbrain", "cal") == ["calibrate"]
    assert complete("ngbrain", "invert", "--sub") == ["--subzones"]
    assert complete("ngbrain", "invert", "--regulariser", "ma") == ["matern"]
    assert complete("ngbrain", "predict", "wav") == ["waves.npz"]


def test_completion_without_its_extra_is_one_line(capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "shtab", None)
    with pytest.raises(SystemExit) as ended:
        main(["--print-completion", "zsh"])
    out, err = capsys.readouterr()
    assert ended.value.code == 2 and out == ""
    assert err == 'ngbrain: shtab is not installed; get it with: pip install "ngbrain[completion]"\n'
