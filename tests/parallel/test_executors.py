"""The same tasks on every executor: the same bits, each result once, and one line for what is wrong."""

import logging
import re
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor

import numpy as np
import pytest
from parallel_tasks import counts, dies_once, lives, raises

from ngbrain import parallel
from ngbrain.errors import InputError, MissingExtra, SolverError
from ngbrain.io import FinishedWork
from ngbrain.parallel import dask_cluster, mpi_job, remote
from ngbrain.surrogate.data import dataset

REAL = [parallel.Task(f"block {i}", dataset._block, ("compression", "sinc", i, "test", range(1), 11)) for i in range(2)]
"""Waves, computed: an assembly, a factorisation and a solve each."""


@pytest.fixture(scope="module")
def cluster():
    """Two worker processes of Dask and a client of theirs."""
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=":0", silence_logs=logging.CRITICAL
        ) as cluster,
        distributed.Client(cluster, set_as_default=False) as client,
    ):
        yield client


@pytest.fixture(scope="module")
def here():
    return parallel.run(REAL)


def assert_same_bits(executor, here, pytestconfig):
    if pytestconfig.getoption("perturb") is not None:
        pytest.skip("what other programs start moves no input")
    there = parallel.run(REAL, executor)
    assert list(there) == list(here)
    for name, block in here.items():
        for column, values in block.items():
            np.testing.assert_array_equal(there[name][column], values)
            assert np.all(np.isfinite(values))


@pytest.mark.one_thread
@pytest.mark.parametrize("kind", [parallel.ProcessExecutor, ProcessPoolExecutor, ThreadPoolExecutor])
def test_the_same_bits_on_this_machine(kind, here, pytestconfig):
    with kind(2 if kind is not ThreadPoolExecutor else 1) as executor:
        assert_same_bits(executor, here, pytestconfig)


@pytest.mark.dask
@pytest.mark.one_thread
def test_the_same_bits_on_dask(cluster, here, pytestconfig):
    assert_same_bits(cluster, here, pytestconfig)


@pytest.mark.mpi
@pytest.mark.one_thread
def test_the_same_bits_on_ranks_of_mpi(here, pytestconfig):
    pytest.importorskip("mpi4py")
    with parallel.open_executor("mpi:2") as executor:
        assert_same_bits(executor, here, pytestconfig)


@pytest.mark.one_thread
def test_the_same_bits_in_jobs_of_slurm(here, pytestconfig, tmp_path):
    submitit = pytest.importorskip("submitit")
    assert_same_bits(submitit.AutoExecutor(tmp_path, cluster="local"), here, pytestconfig)


@pytest.mark.dask
def test_a_dask_worker_killed_in_the_middle_loses_nothing(cluster, tmp_path, caplog):
    (tmp_path / "begun").mkdir()
    tasks = [("killer", dies_once, (tmp_path / "begun", 0))]
    tasks += [(f"task {i}", counts, (tmp_path / "begun", i)) for i in range(1, 8)]
    heard = []
    found = parallel.run(
        tasks, cluster, finished=lambda name, _: heard.append(name), store=FinishedWork(tmp_path / "kept")
    )
    assert list(found) == [name for name, *_ in tasks] and sorted(heard) == sorted(found)
    for i, values in enumerate(found.values()):
        np.testing.assert_array_equal(values, i * np.arange(3.0))
    assert len(list((tmp_path / "begun").glob("0 begun *"))) == 2
    assert len(list((tmp_path / "kept").iterdir())) == len(tasks)
    (line,) = (record.getMessage() for record in caplog.records if record.name == "ngbrain")
    assert re.match(r"Dask worker tcp://127.0.0.1:\d+ is gone with .*killer.*; others compute what it had", line)


@pytest.mark.dask
def test_what_a_task_raises_on_dask_comes_back(cluster):
    with pytest.raises(InputError, match="nose is 3; wanted: one"):
        parallel.run([("a", raises, (InputError("nose", 3, "one"),))], cluster)


@pytest.mark.dask
def test_a_worker_of_another_version_is_refused(cluster, monkeypatch):
    remote.identity.cache_clear()
    with monkeypatch.context() as patch:
        patch.setattr(remote, "version", lambda name: "6.2.0" if name == "ngsolve" else "1")
        remote.identity()
    try:
        with pytest.raises(
            InputError, match=r"^worker tcp://127.0.0.1:\d+ is with .*ngsolve 6\.2\.26.*; wanted: .*ngsolve 6\.2\.0"
        ):
            parallel.run([("a", lives, (1,))], cluster)
        with (
            pytest.raises(InputError, match=r"^worker .* is with .*ngsolve 6\.2\.26"),
            ProcessPoolExecutor(1) as executor,
        ):
            executor.submit(remote.identity.cache_clear).result()  # a fork begins with what was remembered here
            parallel.run([("a", lives, (1,))], executor, on_error="return")
    finally:
        remote.identity.cache_clear()


@pytest.mark.dask
def test_a_worker_without_ngbrain_is_refused(cluster):
    hide = "import sys; sys.hidden = sys.modules.get('ngbrain'); sys.modules['ngbrain'] = None"
    show = "import sys; sys.modules.pop('ngbrain'); sys.hidden and sys.modules.update(ngbrain=sys.hidden)"
    (worker, *_) = cluster.scheduler_info(n_workers=-1)["workers"]
    cluster.run(exec, hide, {}, workers=[worker])
    try:
        with pytest.raises(InputError, match=rf"^worker {worker} is without ngbrain; wanted: ngbrain .* and ngsolve 6"):
            parallel.run([("a", lives, (1,))], cluster)
    finally:
        cluster.run(exec, show, {}, workers=[worker])


@pytest.mark.dask
def test_a_worker_whose_ngbrain_cannot_be_imported_is_refused(cluster):
    name = "ngbrain.parallel.remote"
    hide = f"import sys; sys.hidden = sys.modules.get('{name}'); sys.modules['{name}'] = None"
    show = f"import sys; sys.modules.pop('{name}'); sys.hidden and sys.modules.update({{'{name}': sys.hidden}})"
    (worker, *_) = cluster.scheduler_info(n_workers=-1)["workers"]
    cluster.run(exec, hide, {}, workers=[worker])
    try:
        with pytest.raises(
            InputError, match=rf"^worker {worker} is with an ngbrain that cannot be imported; wanted: .*it said"
        ):
            parallel.run([("a", lives, (1,))], cluster)
    finally:
        cluster.run(exec, show, {}, workers=[worker])


@pytest.mark.mpi
def test_a_killed_rank_ends_the_job_in_one_line_and_the_next_goes_on(tmp_path, capfd):
    pytest.importorskip("mpi4py")
    (tmp_path / "begun").mkdir()
    work = FinishedWork(tmp_path / "kept")
    tasks = [(f"task {i}", counts, (tmp_path / "begun", i)) for i in range(1, 4)]
    tasks += [("killer", dies_once, (tmp_path / "begun", 0))]
    with parallel.open_executor("mpi:1") as executor:
        words = r"^killer: a rank died: Killed \(signal 9\), which ends the MPI job; a restart continues"
        with pytest.raises(SolverError, match=words):
            parallel.run(tasks, executor, store=work)
        with pytest.raises(SolverError, match="which ends the MPI job"):
            parallel.run([("later", lives, (1,))], executor)
    assert capfd.readouterr() == ("", "")
    assert len(list((tmp_path / "kept").iterdir())) == 3
    with parallel.open_executor("mpi:1") as executor:
        found = parallel.run(tasks, executor, store=work)
    assert sorted(path.name.split()[0] for path in (tmp_path / "begun").iterdir()) == ["0", "0", "1", "2", "3"]
    assert [values[1] for values in found.values()] == [1.0, 2.0, 3.0, 0.0]


@pytest.mark.parametrize(
    ("spec", "words"),
    [
        ("0", "^executor is 0; wanted: N |"),
        ("banana", "^executor is 'banana'; wanted: N | dask:ADDRESS"),
        ("dask:", "^executor is 'dask:'"),
        ("mpi:none", "^executor is 'mpi:none'"),
        ("slurm:hours=3", "^executor is slurm:hours=3; wanted: KEY=VALUE of time_min, mem_gb"),
        ("slurm:mem_gb=much", "^executor is slurm:mem_gb=much"),
        ("slurm", "^executor is slurm, and no sbatch is found"),
    ],
)
def test_bad_names_of_executors(spec, words, monkeypatch):
    monkeypatch.setenv("PATH", "/nowhere")
    with pytest.raises(InputError, match=words), parallel.open_executor(spec):
        raise AssertionError("opened")


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "nohost.invalid:8786", "banana"])
def test_an_address_where_no_scheduler_answers(address, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr(dask_cluster, "PATIENCE", 0.3)
    words = f"^executor is dask:{address}, where none answers"
    with pytest.raises(InputError, match=words), parallel.open_executor(f"dask:{address}"):
        raise AssertionError("opened")


def test_an_address_where_none_answers_leaves_no_traceback():
    pytest.importorskip("distributed")
    script = "from ngbrain import parallel\nparallel.open_executor('dask:banana').__enter__()"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.stderr.strip().splitlines()[-1].startswith("ngbrain.errors.InputError: executor is dask:banana")


def test_ranks_that_do_not_start(tmp_path, monkeypatch):
    pytest.importorskip("mpi4py")
    broken = tmp_path / "mpiexec"
    broken.write_text("#!/bin/sh\necho error: no network >&2\nexit 1\n")
    broken.chmod(0o755)
    monkeypatch.setattr(mpi_job.sys, "executable", str(tmp_path / "python"))
    with (
        pytest.raises(
            InputError, match=r"^executor is mpi, whose ranks do not start; wanted: .* it said: error: no network"
        ),
        parallel.open_executor("mpi:1"),
    ):
        raise AssertionError("opened")


@pytest.mark.parametrize(
    ("spec", "package", "extra"),
    [("dask:tcp://127.0.0.1:9", "distributed", "cluster"), ("mpi", "mpi4py", "mpi"), ("slurm", "submitit", "cluster")],
)
def test_a_missing_extra_is_named(spec, package, extra, monkeypatch):
    monkeypatch.setitem(sys.modules, package, None)
    with (
        pytest.raises(
            MissingExtra, match=rf'{package} is not installed; get it with: pip install "ngbrain\[{extra}\]"'
        ),
        parallel.open_executor(spec),
    ):
        raise AssertionError("opened")


def test_numbers_are_processes():
    for none in (None, 1, "1"):
        with parallel.open_executor(none) as executor:
            assert executor is None
    with parallel.open_executor("2") as executor:
        assert executor.workers == 2 and parallel.run([("a", lives, (1,))], executor) == {"a": 1}
