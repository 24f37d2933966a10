"""The pages of the Python interface: one a package, with what its `__all__` names and a table of its modules."""

from __future__ import annotations

import ast
import importlib
import inspect
import pkgutil
from pathlib import Path
from types import ModuleType
from typing import Any, get_origin

import docstrings
import stage

import ngbrain

ROOT = "ngbrain"


def add(pages: stage.Pages) -> None:
    """Stage a page for each package and the page that lists them."""
    known = dict[int, str]()
    rooms = [name for name in modules(ROOT, deep=False) if is_package(name)]
    texts = {name: package_page(name, known) for name in rooms}
    tops = [name for name in modules(ROOT, deep=False) if not is_package(name)]
    texts[f"{ROOT}.modules"] = top_page(tops, known)
    for name, text in texts.items():
        pages.write(f"reference/api/{name}.rst", text)
    short = [full.rpartition(".")[2] for full in known.values()]
    docstrings.KNOWN |= {
        full.rpartition(".")[2]: full for full in known.values() if short.count(full.rpartition(".")[2]) == 1
    }
    pages.write("reference/api/index.rst", face_page(known, list(texts)))


def modules(package: str, deep: bool = True) -> list[str]:
    """Full names of the public modules and packages in a package, those of packages in it too."""
    found = []
    for each in sorted(pkgutil.iter_modules([str(source(package).parent)]), key=lambda each: each.name):
        name = f"{package}.{each.name}"
        if not each.name.startswith("_"):
            found += [name, *(modules(name) if deep and each.ispkg else [])]
    return found


def source(name: str) -> Path:
    """The file of a module or package."""
    path = stage.ROOT.joinpath(*name.split("."))
    return path / "__init__.py" if path.is_dir() else path.with_suffix(".py")


def is_package(name: str) -> bool:
    """Whether a module is a package."""
    return source(name).name == "__init__.py"


def load(name: str) -> ModuleType | None:
    """A module; None where a package that it needs is not installed."""
    try:
        return importlib.import_module(name)
    except ImportError:
        return None


def unloaded(name: str) -> list[str]:
    """What stands for a module that needs a package which is not here: its docstring."""
    about = ast.get_docstring(ast.parse(source(name).read_text())) or ""
    lines = docstrings.prepare(about.splitlines())
    return [*lines, "", "*Needs packages of an extra that were not installed where this site was built.*", ""]


def exported(package: ModuleType, name: str) -> dict[str, Any]:
    """What `__all__` of a package names that it defines, modules left out: these are in the page anyway."""
    own = set(modules(name, deep=False))
    names = (
        each for each in getattr(package, "__all__", ()) if not each.startswith("_") and f"{name}.{each}" not in own
    )
    found = {each: getattr(package, each) for each in names}
    return {each: value for each, value in found.items() if is_code(value) and value.__module__.startswith(name)}


def is_code(value: Any) -> bool:
    """Whether something is a class or a function; data are documented with the module that defines them."""
    return inspect.isclass(value) or inspect.isroutine(value)


def package_page(name: str, known: dict[int, str]) -> str:
    """The page of a package: what it exports in full and its modules in a table, or where it exports nothing these in full.

    Parameters
    ----------
    name : str
        Of the package.
    known : dict
        `id` of an object → the name that it is documented under; what is documented here is added.
    """
    package, inner = load(name), modules(name)
    lines = [heading(name, "="), *([f".. automodule:: {name}", ""] if package else unloaded(name))]
    shown = exported(package, name) if package else {}
    for each, value in shown.items():
        if id(value) not in known:
            known[id(value)] = f"{name}.{each}"
            lines += directive(f"{name}.{each}", value)
    if shown:
        rows = [f"   * - ``{each.removeprefix(name + '.')}``\n     - {first_line(each)}" for each in inner]
        lines += [*([heading("Modules", "-"), ".. list-table::", ""] if rows else []), *rows, ""]
    else:
        for each in inner:
            lines += module_section(each, known, set())
    return "\n".join(lines)


def first_line(name: str) -> str:
    """The first line of a module's docstring."""
    about = ast.get_docstring(ast.parse(source(name).read_text())) or ""
    return docstrings.plain(" ".join(about.partition("\n\n")[0].split()))


def module_section(name: str, known: dict[int, str], exported_here: set[str]) -> list[str]:
    """The section of a module: what it defines and no page has shown yet."""
    module = load(name)
    if module is None:
        return [heading(f"``{name.removeprefix(ROOT + '.')}``", "-"), *unloaded(name)]
    hidden = [
        each
        for each, value in vars(module).items()
        if not each.startswith("_") and (id(value) in known or each in exported_here or get_origin(value) is not None)
    ]
    lines = [heading(f"``{name.removeprefix(ROOT + '.')}``", "-"), f".. automodule:: {name}", "   :members:"]
    if hidden:
        lines.append(f"   :exclude-members: {', '.join(sorted(hidden))}")
    for value in vars(module).values():
        if is_code(value) and getattr(value, "__module__", "") == name:
            known.setdefault(id(value), f"{name}.{value.__name__}")
    return [*lines, ""]


def top_page(names: list[str], known: dict[int, str]) -> str:
    """The page of the modules that lie in no package."""
    lines = [heading("Modules at the top", "="), "Errors, units, sample data, threads, pictures.", ""]
    for name in names:
        if name != f"{ROOT}.__main__":
            lines += module_section(name, known, set())
    return "\n".join(lines)


def face_page(known: dict[int, str], rooms: list[str]) -> str:
    """The first page: what `import ngbrain as nb` shows, and the packages."""
    lines = [
        heading("Python interface", "="),
        f".. automodule:: {ROOT}",
        "",
        heading("Names", "-"),
        ".. list-table::",
        "",
    ]
    for name in ngbrain.__all__:
        value = getattr(ngbrain, name)
        if not is_code(value):
            continue
        first = (inspect.getdoc(value) or "").partition("\n")[0]
        place = known.get(id(value), f"{value.__module__}.{value.__qualname__}")
        lines += [f"   * - :py:obj:`nb.{name} <{place}>`", f"     - {first}"]
    return "\n".join([*lines, "", heading("Packages", "-"), *toctree(rooms)])


def directive(name: str, value: Any) -> list[str]:
    """What documents an object."""
    kind = "autoclass" if inspect.isclass(value) else "autofunction"
    return [f".. {kind}:: {name}", *(["   :members:"] if kind == "autoclass" else []), ""]


def heading(text: str, line: str) -> str:
    """A heading."""
    return f"{text}\n{line * len(text)}\n"


def toctree(names: list[str]) -> list[str]:
    """A table of contents."""
    return [".. toctree::", "   :maxdepth: 1", "", *(f"   {name}" for name in names), ""]
