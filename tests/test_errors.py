"""Messages are one line and say what to do; the hierarchy is what the command line's exit statuses rest on."""

import pickle

import pytest

from ngbrain import errors


def test_input_error_names_file_field_value_and_what_is_wanted():
    error = errors.InputError("tissue.mu_kPa", -1.0, "a positive modulus", file="case.toml")
    assert str(error) == "case.toml: tissue.mu_kPa is -1.0; wanted: a positive modulus"
    assert (error.file, error.field, error.value) == ("case.toml", "tissue.mu_kPa", -1.0)


def test_input_error_without_a_file():
    assert str(errors.InputError("order", 0, "1 to 6")) == "order is 0; wanted: 1 to 6"


@pytest.mark.parametrize(
    ("error", "builtin"),
    [
        (errors.InputError("a", 1, "2"), ValueError),
        (errors.ConvergenceError("stopped"), RuntimeError),
        (errors.InvertedElementError("det F <= 0"), RuntimeError),
        (errors.ContactError("too deep"), RuntimeError),
        (errors.MissingExtra("torch", "train"), ImportError),
    ],
    ids=lambda value: getattr(value, "__name__", type(value).__name__),
)
def test_one_line_caught_by_base_and_by_builtin(error, builtin):
    assert isinstance(error, errors.NgbrainError) and isinstance(error, builtin)
    assert isinstance(error, errors.SolverError) == (builtin is RuntimeError)
    assert str(error) and "\n" not in str(error)


@pytest.mark.parametrize(
    "error",
    [
        errors.InputError("a", 1, "2", file="case.toml"),
        errors.MissingExtra("torch", "train"),
        errors.ContactError("too deep"),
    ],
    ids=lambda error: type(error).__name__,
)
def test_errors_come_back_from_another_process(error):
    again = pickle.loads(pickle.dumps(error))
    assert type(again) is type(error) and str(again) == str(error) and vars(again) == vars(error)


def test_line_breaks_in_what_was_found_do_not_make_two_lines():
    assert str(errors.InputError("a", "x\n y", "2", file="c\nd.toml")) == "c d.toml: a is x y; wanted: 2"
    assert str(errors.ConvergenceError("no\r\nconvergence")) == "no convergence"


def test_require_returns_the_module_asked_for():
    assert errors.require("xml.dom.minidom", "report").__name__ == "xml.dom.minidom"


@pytest.mark.parametrize("name", ["ngbrain_no_such_package", "ngbrain_no_such_package.part"])
def test_require_of_an_absent_package_gives_the_pip_command(name):
    with pytest.raises(errors.MissingExtra) as caught:
        errors.require(name, "mri")
    assert str(caught.value) == 'ngbrain_no_such_package is not installed; get it with: pip install "ngbrain[mri]"'
    assert isinstance(caught.value.__cause__, ImportError)


@pytest.mark.parametrize("typo", ["widht_mm", "width", "Width_mm"])
def test_nearest_finds_the_key_meant(typo):
    assert errors.nearest(typo, ["length_mm", "width_mm", "depth_mm"]) == "did you mean 'width_mm'?"


def test_nearest_lists_all_when_none_is_close():
    assert errors.nearest("colour", iter(["width_mm", "depth_mm"])) == "one of depth_mm, width_mm"
