"""One thread, no chatter and a fixed seed for every test; options that change what results must not depend on."""

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # read once, when numpy and ngsolve are loaded

from contextlib import nullcontext

import ngsolve
import numpy as np
import pytest
from perturbation import perturb

from ngbrain.io.cache import cache_folder

ngsolve.ngsglobals.msg_level = 0
ngsolve.SetNumThreads(1)


def pytest_addoption(parser):
    group = parser.getgroup("ngbrain", "what results must not depend on")
    group.addoption(
        "--perturb", type=int, metavar="SEED", help="move mesh points, time steps and loads in their last digits"
    )
    group.addoption(
        "--ngs-threads", type=int, default=1, metavar="N", help="threads of NGSolve's task manager, 1 for none"
    )


def pytest_report_header(config):
    seed, threads = config.getoption("perturb"), config.getoption("ngs_threads")
    moved = "as they are" if seed is None else f"moved in their last digits by seed {seed}"
    return f"ngbrain: NGSolve {ngsolve.__version__}, threads {threads}, inputs {moved}"


def pytest_configure(config):
    if (seed := config.getoption("perturb")) is None:
        return
    patch = perturb(seed)
    config.add_cleanup(patch.undo)
    if not hasattr(config, "workerinput"):  # workers of xdist inherit it: others must not find what is made here
        patch.setenv("NGBRAIN_CACHE", str(cache_folder() / f"perturbed-{seed}"))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item):
    alone = item.get_closest_marker("one_thread") is not None
    threads = 1 if alone else item.config.getoption("ngs_threads")
    ngsolve.SetNumThreads(threads)
    with ngsolve.TaskManager() if threads > 1 else nullcontext():
        return (yield)


@pytest.fixture
def rng() -> np.random.Generator:
    """Random numbers, the same ones in every run and in every test."""
    return np.random.default_rng(20260101)
