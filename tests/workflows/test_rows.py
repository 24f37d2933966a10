"""A row is identified by its inputs, not by its name or location."""

import json
import shutil

import pytest

from ngbrain.workflows.listing import read_list
from ngbrain.workflows.rows import Record, digest_case


@pytest.fixture
def study(tmp_path):
    folder = tmp_path / "study"
    folder.mkdir()
    (folder / "waves.nii.gz").write_bytes(b"image")
    (folder / "waves.json").write_text(json.dumps({"magnitude": "magnitude.nii", "frequency": 60}))
    (folder / "magnitude.nii").write_bytes(b"magnitude")
    (folder / "scene.toml").write_text('[geometry]\nkind = "scan"\nimage = "t1.nii"\n')
    (folder / "t1.nii").write_bytes(b"t1")
    return folder


def digest(folder, row="a,invert,waves.nii.gz,0.02"):
    path = folder / "list.csv"
    path.write_text(f"name,verb,input,noise\n{row}\n")
    (case,) = read_list(path)
    return digest_case(case)


def test_the_same_files_elsewhere_by_another_name_are_the_same_work(study, tmp_path):
    before = digest(study)
    there = tmp_path / "there"
    shutil.copytree(study, there)
    assert digest(there, "other,invert,waves.nii.gz,0.02") == before


@pytest.mark.parametrize("changed", ["waves.nii.gz", "waves.json", "magnitude.nii"])
def test_what_a_file_names_belongs_to_it(study, changed):
    before = digest(study)
    (study / changed).write_bytes(
        (study / changed).read_bytes().replace(b"image", b"imago").replace(b"60", b"50") + b" "
    )
    assert digest(study) != before


def test_scenes_name_images(study):
    before = digest(study, "a,simulate,scene.toml,")
    (study / "t1.nii").write_bytes(b"another")
    assert digest(study, "a,simulate,scene.toml,") != before


def test_options_verb_and_code_count(study, monkeypatch):
    found = {digest(study), digest(study, "a,invert,waves.nii.gz,0.03"), digest(study, "a,predict,waves.nii.gz,")}
    monkeypatch.setattr("ngbrain.workflows.rows.code_digest", lambda _: "of other code")
    assert len(found | {digest(study)}) == 4


def test_a_folder_of_slices_is_read_whole(study):
    slices = study / "dicom"
    slices.mkdir()
    (slices / "1").write_bytes(b"1")
    before = digest(study, "a,mesh,dicom,")
    (slices / "2").write_bytes(b"2")
    assert digest(study, "a,mesh,dicom,") != before


def test_a_damaged_record_is_none(tmp_path):
    record = Record("abc", 2, "failed", "why", ("note",))
    record.write(tmp_path)
    assert Record.read(tmp_path) == record and Record.read(tmp_path / "none") is None
    for text in ("{", "[]", '{"digest": "abc"}', '{"notes": [], "other": 1, "digest": ""}'):
        (tmp_path / "row.json").write_text(text)
        assert Record.read(tmp_path) is None
