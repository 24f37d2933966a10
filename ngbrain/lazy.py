"""Names of a package that are imported on first use, since importing everything takes seconds.

A package lists them as imports, where type checkers and editors read them, and needs no second list:

    if TYPE_CHECKING:
        from ngbrain.forward.solid.problem import Problem
    else:
        __getattr__, __dir__ = lazy_names(__name__)
"""

from collections.abc import Callable, Mapping
from functools import cache
from importlib import import_module, resources
from typing import Any

__all__ = ["definitions", "lazy_names"]


def lazy_names(package: str) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """The functions `__getattr__` and `__dir__` of a package, for the imports of its `if TYPE_CHECKING` block and its modules.

    Parameters
    ----------
    package : str
        Its `__name__`.

    Returns
    -------
    get : callable
        From a name to what it stands for.
    listed : callable
        The names of `__all__`, sorted.

    Examples
    --------
    >>> get, listed = lazy_names("ngbrain.forward")
    >>> get("Problem").__module__, get("statics").__name__, "LoadPath" in listed()
    ('ngbrain.forward.solid.problem', 'ngbrain.forward.statics', True)
    """

    def get(name: str) -> Any:
        missing = AttributeError(f"module {package!r} has no attribute {name!r}")
        if name.startswith("_"):
            raise missing
        if name in definitions(package):
            module, own = definitions(package)[name]
            return getattr(import_module(module), own)
        try:
            return import_module(f"{package}.{name}")
        except ModuleNotFoundError as error:
            if error.name == f"{package}.{name}":
                raise missing from None
            raise AttributeError(f"{missing}: {error}") from error  # not installed; `help` and `hasattr` go on

    def listed() -> list[str]:
        return sorted(import_module(package).__all__)

    return get, listed


@cache
def definitions(package: str) -> Mapping[str, tuple[str, str]]:
    """Name → module and name there, from the `if TYPE_CHECKING` block of a package's source.

    >>> definitions("ngbrain")["segment"]
    ('ngbrain.image.labelling', 'label_tissues')
    """
    import ast  # not needed by `import ngbrain` itself

    tree = ast.parse((resources.files(package) / "__init__.py").read_text(encoding="utf-8"))
    blocks = [n for n in tree.body if isinstance(n, ast.If) and ast.unparse(n.test) == "TYPE_CHECKING"]
    imports = [n for block in blocks for n in block.body if isinstance(n, ast.ImportFrom) and n.module != package]
    return {a.asname or a.name: (str(n.module), a.name) for n in imports for a in n.names}
