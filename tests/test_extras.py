"""The extras of setup.cfg: what they name is used, and what the code asks for is in the extra that it names."""

import ast
import configparser
import re
from pathlib import Path

import pytest

import ngbrain

ROOT = Path(__file__).parents[1]

# Distribution → its module, where that has another name.
MODULES = {
    "ipython": "IPython",
    "nvmath-python": "nvmath",
    "python-mumps": "mumps",
    "PyWavelets": "pywt",
    "scikit-image": "skimage",
}

# What no line imports, and why an extra names it.
LOADED = {
    "mkl": "NGSolve loads its library, when PARDISO is asked for",
    "nvidia-cuda-runtime-cu12": "NGSolve's CUDA module is linked to it",
    "nvidia-cuda-nvrtc-cu12": "NGSolve's CUDA module is linked to it",
    "nvidia-nvjitlink-cu12": "NGSolve's CUDA module is linked to it",
    "mpich": "mpi4py is linked to it, and it brings mpiexec",
    "webgui_jupyter_widgets": "viz reads the viewer's program from it",
}

# Tools that the Makefile, the CI's scripts or the site's settings run: what these say.
TOOLS = {
    "pytest": "-m pytest",
    "pytest-xdist": "--dist",
    "ruff": "/ruff check",
    "mypy": "/mypy",
    "import-linter": "/lint-imports",
    "ipykernel": "kernel_name=",
    "myst-nb": '"myst_nb"',
    "furo": '"furo"',
}


def extras():
    """Extra → the distributions that it names, those of other extras included."""
    config = configparser.ConfigParser()
    config.read(ROOT / "setup.cfg")
    given = dict(config["options.extras_require"])

    def named(extra):
        found = set()
        for line in given[extra].split("\n"):
            if inner := re.fullmatch(r"ngbrain\[(.*)\]", line):
                found |= set().union(*map(named, inner[1].split(",")))
            elif line:
                found.add(re.match(r"[\w-]+", line)[0])
        return found

    return {extra: named(extra) for extra in given}


def trees(*folders):
    for folder in folders:
        for path in sorted(folder.rglob("*.py")):
            yield path, ast.parse(path.read_text())


def imports(tree):
    """Modules that a file imports, and (module, extra) of what it requires; None for a module that a variable names."""
    modules, required = set(), set()
    for node in ast.walk(tree):
        match node:
            case ast.Import(names=names):
                modules |= {name.name.partition(".")[0] for name in names}
            case ast.ImportFrom(module=str(module), level=0):
                modules.add(module.partition(".")[0])
            case ast.Call(func=ast.Name(id="require"), args=[package, ast.Constant(value=extra)]):
                known = isinstance(package, ast.Constant)
                required.add((package.value.partition(".")[0] if known else None, extra))
    return modules | {module for module, _ in required if module}, required


LIBRARY = {path: imports(tree) for path, tree in trees(Path(ngbrain.__file__).parent)}


def module(distribution):
    return MODULES.get(distribution, distribution)


def test_the_library_uses_every_package_of_an_extra():
    used = set().union(*(modules for modules, _ in LIBRARY.values()))
    of_users = {extra: names for extra, names in extras().items() if extra not in ("dev", "docs")}
    for extra, names in of_users.items():
        unused = {name for name in names - set(LOADED) if module(name) not in used}
        assert not unused, f"{extra} names {unused}, which nothing imports"
    assert set(LOADED) <= set().union(*of_users.values())


def test_development_uses_every_package_of_its_extra():
    builder = ROOT / "tutorials/guide/builder"
    used = set().union(
        *(imports(tree)[0] for _, tree in trees(ROOT / "ngbrain", ROOT / "tests", ROOT / ".ci", builder))
    )
    scripts = [ROOT / "Makefile", *(ROOT / ".ci").iterdir(), builder / "conf.py"]
    text = "\n".join(path.read_text() for path in scripts if path.is_file())
    for name in extras()["dev"]:
        assert TOOLS[name] in text if name in TOOLS else module(name) in used or name in LOADED, f"nothing uses {name}"


@pytest.mark.parametrize(
    ("of", "extra"), sorted({pair for _, required in LIBRARY.values() for pair in required if pair[0]})
)
def test_what_is_required_is_in_its_extra(of, extra):
    assert of in {module(name) for name in extras()[extra]}


def test_every_command_works_after_make_demo():
    asked = {extra for path, (_, required) in LIBRARY.items() if path.parent.name == "cli" for _, extra in required}
    assert asked == {"mri", "report", "surrogate"}
    for extra in asked:
        assert extras()[extra] <= extras()["demo"], f"demo lacks {extra}"
