"""What `import ngbrain as nb` and its packages show: every name is there, is documented, and costs nothing until it is used."""

import doctest
import inspect
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

import ngbrain as nb
from ngbrain.lazy import definitions

CALLED = [name for name in nb.__all__ if not inspect.ismodule(getattr(nb, name)) and name != "__version__"]
LONG = ("segment",)
"""What takes half a minute on any head: lesson 1 shows it."""
ROOT = Path(__file__).parents[1]
PACKAGE = Path(nb.__file__).parent
PACKAGES = sorted(".".join(("ngbrain", *p.parent.relative_to(PACKAGE).parts)) for p in PACKAGE.rglob("__init__.py"))
ROOMS = [name for name in PACKAGES if name.count(".") == 1 and name != "ngbrain.cli"]
FOR_USERS = sorted(
    path
    for folder in ("tutorials", "benchmarks")
    for path in (ROOT / folder).rglob("*")
    if path.suffix in (".py", ".md") and path.is_file() and "builder" not in path.parts  # which makes the site
)
DEEP = re.compile(r"^\s*(?:>>> |\.\.\. )?(?:from|import) +(ngbrain(?:\.\w+){2,})", re.M)
"""An import of a module two or more levels below ngbrain."""


def test_tab_shows_what_is_for_users_and_nothing_else():
    assert dir(nb) == sorted(nb.__all__) and 25 <= len(nb.__all__) <= 40


@pytest.mark.parametrize("name", sorted(set(CALLED) - set(LONG)))
def test_every_name_has_an_example(name):
    assert doctest.DocTestParser().get_examples(inspect.getdoc(getattr(nb, name)) or "")


@pytest.mark.parametrize("name", sorted(set(nb.__all__) - set(CALLED) - {"__version__"}))
def test_every_package_has_a_table_of_contents(name):
    module = getattr(nb, name)
    assert len(module.__doc__.splitlines()) > 1 or not hasattr(module, "__path__"), name


def test_a_name_that_is_not_there_is_an_attribute_error():
    with pytest.raises(AttributeError, match="has no attribute 'inverted'"):
        nb.inverted  # noqa: B018


def test_importing_it_imports_nothing_heavy():
    heavy = (
        "import sys, ngbrain; sys.exit(any(name in sys.modules for name in ('numpy', 'scipy', 'ngsolve', 'netgen')))"
    )
    assert subprocess.run([sys.executable, "-c", heavy], check=False).returncode == 0


def test_a_problem_imports_neither_the_laboratory_nor_optimisers_nor_plots():
    """They would add a second to every process that runs one."""
    heavy = "'ngbrain.materials.lab', 'scipy.optimize', 'scipy.stats', 'matplotlib'"
    code = f"import sys, ngbrain.forward.solid.problem; sys.exit(any(name in sys.modules for name in ({heavy})))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize("room", ROOMS)
def test_a_room_gives_what_its_table_of_contents_lists(room):
    module = import_module(room)
    for name in module.__all__:
        assert getattr(module, name) is not None
        assert re.search(rf"`{name}`", module.__doc__), f"{name} is not in the docstring of {room}"


@pytest.mark.parametrize("package", PACKAGES)
def test_a_name_for_users_is_not_also_a_module(package):
    """The module would replace what has its name as soon as something imports it."""
    folder = PACKAGE.joinpath(*package.split(".")[1:])
    modules = {path.stem for path in folder.glob("*.py")} | {path.parent.name for path in folder.glob("*/__init__.py")}
    assert not modules & set(definitions(package))


@pytest.mark.parametrize("package", [name for name in PACKAGES if definitions(name)])
def test_a_name_of_a_package_is_what_its_home_defines(package):
    shown = import_module(package)
    assert set(definitions(package)) <= set(shown.__all__)
    for name, (module, own) in definitions(package).items():
        assert getattr(shown, name) is getattr(import_module(module), own)


def test_a_module_is_an_attribute_before_it_is_imported():
    code = "import ngbrain as nb; nb.schema.fields.number; nb.mesh.geometry.sizing"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_a_module_whose_library_is_missing_says_which(monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    monkeypatch.delitem(sys.modules, "ngbrain.surrogate.training.baselines", raising=False)
    monkeypatch.delattr("ngbrain.surrogate.training.baselines", raising=False)
    with pytest.raises(AttributeError, match=r"no attribute 'baselines'.*torch"):
        nb.surrogate.training.baselines  # noqa: B018


def test_users_import_from_ngbrain_or_one_level_below():
    assert len(FOR_USERS) > 80
    deep = [
        f"{p.relative_to(ROOT)}: {found}"
        for p in (ROOT / "README.md", *FOR_USERS)
        for found in DEEP.findall(p.read_text())
    ]
    assert not deep
