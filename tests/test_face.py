"""What `import ngbrain as nb` shows: every name is there, is documented with an example, and costs nothing until it is used."""

import doctest
import inspect
import subprocess
import sys

import pytest

import ngbrain as nb

CALLED = [name for name in nb.__all__ if not inspect.ismodule(getattr(nb, name)) and name != "__version__"]
LONG = ("segment",)
"""What takes half a minute on any head: lesson 1 shows it."""


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
