"""A part that has nothing to do with surgery goes to TOML and back; what a file may not be."""

import tomllib
from dataclasses import dataclass

import pytest

from ngbrain.errors import InputError
from ngbrain.mesh import block
from ngbrain.schema import document
from ngbrain.schema.document import Section, brief, entries, read_toml, to_toml
from ngbrain.schema.fields import choice, integer, number, pattern, table, text


@dataclass(frozen=True, kw_only=True)
class Sail(Section):
    height: float = number("height_mm")
    cloth: str = choice("cloth", "cotton", ["cotton", "hemp"])


@dataclass(frozen=True, kw_only=True)
class Boat(Section):
    name: str = text("name", "Argo", "one word", str.isalpha)
    crew: int = integer("crew", 1, 1, 8)
    draught: float | None = number("draught_mm", None, least=100.0)
    ports: str = pattern("ports", ".*")
    sails: tuple[Sail, ...] = table(Sail, size=0)


BOAT = Boat(sails=(Sail(height=4.2), Sail(height=0.1 + 0.2, cloth="hemp")))


def test_there_and_back():
    assert tomllib.loads(to_toml(BOAT.to_dict())) == BOAT.to_dict()
    assert Boat.read(BOAT.to_dict()) == BOAT
    assert to_toml(BOAT.to_dict()).startswith('name = "Argo"\ncrew = 1\nports = ".*"\n\n[[sail]]\nheight_mm = 4200.0\n')


def test_one_way_of_saying_it_for_files_and_for_python():
    with pytest.raises(InputError, match=r"^boat\.draught_mm is 99\.0; wanted: a length in mm of at least 100$"):
        Boat(draught=0.099, sails=BOAT.sails)
    with pytest.raises(InputError, match=r"^boat\.draught_mm is 99; wanted: a length in mm of at least 100$"):
        Boat.read({"draught_mm": 99, "sail": []}, "boat")
    with pytest.raises(InputError, match=r"^sail#2\.height_mm is missing; wanted: a length in mm greater than 0$"):
        Boat.read({"sail": [{"height_mm": 1}, {}]})
    assert entries(Boat)["crew"].wanted == "a whole number from 1 to 8" and brief(None) == "missing"


@pytest.mark.parametrize("length", [document.LARGEST, document.LARGEST + 1])
def test_a_file_of_a_megabyte_is_read_and_no_larger_one(tmp_path, length):
    path = tmp_path / "boat.toml"
    path.write_bytes(b"crew = 3\n".ljust(length, b"#"))
    if length <= document.LARGEST:
        assert read_toml(path) == {"crew": 3}
    else:
        with pytest.raises(InputError, match=r"boat\.toml: file is a file of 1,000,001 bytes"):
            read_toml(path)


@pytest.fixture(scope="module")
def mesh():
    return block(maxh=0.05)


@pytest.mark.parametrize("kept", ["port|starboard", "p.*t", "(?:a|b)+", "(?!c)d", "(?=d)d", "[a-c]{2}", r"\w+"])
def test_patterns_that_python_and_ngsolve_read(mesh, kept):
    assert Boat(ports=kept, sails=BOAT.sails).ports == kept
    mesh.Materials(kept)


@pytest.mark.parametrize("refused", ["(?i)port", "(?P<a>b)", "(?<=a)b", "(?#a)b", "a{,3}"])
def test_patterns_that_only_python_reads(mesh, refused):
    with pytest.raises(InputError, match=r"^boat\.ports is .*ECMAScript"):
        Boat(ports=refused, sails=BOAT.sails)
    with pytest.raises(RuntimeError, match="regular expression"):
        mesh.Materials(refused)


@pytest.mark.parametrize("refused", ["(", "", "a" * 201, "[b-a]", "a\nb"])
def test_patterns_that_are_none(refused):
    with pytest.raises(InputError, match=r"^boat\.ports is .*; wanted: a name or a regular expression"):
        Boat(ports=refused, sails=BOAT.sails)
