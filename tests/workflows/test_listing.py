"""The list of a cohort: faults are reported with line and column before the computation."""

import pytest

from ngbrain.cli.options.cohort import SAMPLE
from ngbrain.errors import InputError
from ngbrain.workflows.listing import read_list, values_of


def listed(folder, text, encoding="utf-8"):
    for name in ("a.npz", "b.npz", "t1.nii", "lh.pial", "lh.white"):
        (folder / name).touch()
    path = folder / "list.csv"
    path.write_bytes(text.encode(encoding))
    return path


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("name,verb,input\na,invert,gone.npz\n", ["line 2 (a), input", "'gone.npz', which is missing"]),
        ("name,verb,input\na,invert,\n", ["line 2 (a), input", "missing"]),
        ("name,verb,input\na,invert,a.npz\n\nA,invert,b.npz\n", ["line 4, name", "'A', as in line 2"]),
        ("name,verb,input\n../a,invert,a.npz\n", ["line 2, name", "'../a'", "folder"]),
        ("name,verb,input\n,invert,a.npz\n", ["line 2, name", "missing"]),
        ("name,verb,input\na,invrt,a.npz\n", ["line 2 (a), verb", "'invrt'", "'invert'"]),
        ("name,verb,input\na,calibrate,a.npz\n", ["line 2 (a), verb", "'calibrate'"]),
        ("name,input\na,a.npz\n", ["columns", "verb is missing", "--verb"]),
        ("verb,input\ninvert,a.npz\n", ["columns", "name is missing"]),
        ("name,verb,input,noise,Noise\na,invert,a.npz,1,1\n", ["columns", "there twice (noise)"]),
        ("name,verb,input,nosie\na,invert,a.npz,1\n", ["column", "'nosie'", "noise, if that is meant", "about_"]),
        ("name,verb,input,noise\na,invert,a.npz,much\n", ["line 2 (a), noise", "'much'", "invalid float"]),
        ("name,verb,input,noise\na,invert,a.npz,0,02\n", ["line 2", "5 cells", "decimals with a point"]),
        ('name,verb,input,noise\na,invert,a.npz,"0,02"\n', ["line 2 (a), noise", "'0,02'"]),
        ("name,verb,input,bars\na,invert,a.npz,perhaps\n", ["line 2 (a), bars", "yes, no"]),
        ("name,verb,input,size\na,invert,a.npz,\nb,mesh,t1.nii,2\nc,invert,a.npz,3\n", ["line 4 (c), size", "no such"]),
        ("name,verb,input,weight\na,invert,a.npz,72\n", ["line 2 (a), weight", "evidence", "about_"]),
        ("name,verb,input,atlas\na,mesh,t1.nii,gone.nii\n", ["line 2 (a), atlas", "'gone.nii', which is missing"]),
        ("name,verb,input\na,mesh,t1.nii|gone\n", ["line 2 (a), input", "'gone'"]),
        ("name,verb,input,\na,invert,a.npz,3\n", ["line 2 (a)", "column without a name"]),
        ("name,verb,input\n", ["without a row"]),
        ("", ["without a row"]),
        ('name,verb,input\na,invert,"a.npz\n', ["line", "unreadable"]),
    ],
)
def test_bad_lists(tmp_path, text, words):
    path = listed(tmp_path, text)
    with pytest.raises(InputError) as refused:
        read_list(path)
    said = str(refused.value)
    assert said.startswith(f"{path}: ") and all(word in said for word in words), said


def test_every_fault_is_said(tmp_path, caplog):
    path = listed(tmp_path, "name,verb,input\na,invert,x.npz\nb,invert,a.npz\nc,invert,y.npz\n")
    with pytest.raises(InputError, match=r"line 4 \(c\)"):
        read_list(path)
    assert [record.message for record in caplog.records] == [
        f"{path}: line 2 (a), input is 'x.npz', which is missing; wanted: a file, relative to the list"
    ]


PLAIN = "name,verb,input,noise,by_label,drop-outliers,group\na,invert,a.npz,0.02,yes,no,grün\nb,invert,b.npz,,,,\n"


@pytest.mark.parametrize(
    ("text", "encoding"),
    [
        (PLAIN, "utf-8"),
        (PLAIN, "utf-8-sig"),
        (PLAIN, "utf-16"),
        (PLAIN.replace("\n", "\r\n"), "utf-8"),
        (PLAIN.replace(",", ";").replace("0.02", "0,02"), "utf-8-sig"),
        (PLAIN.replace(",", "\t"), "utf-16"),
        ("# what this is\n#\n" + PLAIN.replace("by_label", "--by-label").replace("yes", "X"), "utf-8"),
    ],
)
def test_lists_as_spreadsheets_write_them(tmp_path, text, encoding):
    first, second = read_list(listed(tmp_path, text, encoding))
    assert first.argv == ["invert", str(tmp_path / "a.npz"), "--noise=0.02", "--by-label", "--no-drop-outliers"]
    assert second.argv == ["invert", str(tmp_path / "b.npz")]
    assert values_of([first, second], "group") == {"a": "grün", "b": ""}


def test_columns_of_ones_own(tmp_path):
    text = "name,input,about_site,age\na,t1.nii,Ulm,40\n"
    (case,) = read_list(listed(tmp_path, text), "mesh")
    assert case.about == {"site": "Ulm", "age": "40"} and not case.options
    with pytest.raises(InputError, match="a column of one's own: site, age"):
        values_of([case], "group")


def test_places_surfaces_and_repeated_options(tmp_path):
    text = 'name,input,site,landmark\na,grey=lh.pial|lh.white,"-20,0,30","hand=1,2,3|foot=4,5,6"\n'
    (case,) = read_list(listed(tmp_path, text), "mesh")
    assert case.inputs == (f"grey={tmp_path / 'lh.pial'}", str(tmp_path / "lh.white"))
    assert case.options == ("--site=-20,0,30", "--landmark=hand=1,2,3", "--landmark=foot=4,5,6")


def test_the_template_is_a_list(tmp_path):
    for name in ("mni152_t1.nii.gz", "waves_plane.npz", "plate.toml"):
        (tmp_path / name).touch()
    path = tmp_path / "list.csv"
    path.write_bytes(SAMPLE.read_bytes())
    cases = read_list(path)
    assert [case.verb for case in cases] == ["mesh", "predict", "invert", "simulate"]
    assert cases[0].options == ("--size=10",) and cases[2].options == ("--regulariser=smooth",)
