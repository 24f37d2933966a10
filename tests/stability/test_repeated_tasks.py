"""A task that dies between its result and the word that it is there: repeated naively it leaves two results, ours one."""

import multiprocessing

import numpy as np
from parallel_tasks import writes_and_dies_once

from ngbrain import parallel
from ngbrain.io import FinishedWork


def naive(folder):
    """What a loop over processes does: start again whatever has ended badly."""
    context = multiprocessing.get_context("spawn")
    for _ in range(2):
        process = context.Process(target=writes_and_dies_once, args=(folder, 3), kwargs={"callback": None})
        process.start()
        process.join()
        if process.exitcode == 0:
            return


def test_a_repeated_task_leaves_one_result(tmp_path, caplog):
    naive(tmp_path)
    assert (tmp_path / "table.csv").read_text().splitlines() == ["3,9", "3,9"]
    (tmp_path / "table.csv").unlink()

    heard, work = [], FinishedWork(tmp_path / "finished")
    tasks = [parallel.Task("three", writes_and_dies_once, (tmp_path, 3))]
    found = parallel.run(tasks, 2, store=work, finished=lambda name, _: heard.append(name))
    again = parallel.run(tasks, 2, store=work)
    assert heard == ["three"] and len(list(work.folder.iterdir())) == 1 and len(caplog.messages) == 1
    np.testing.assert_array_equal([found["three"], again["three"]], [[3, 9], [3, 9]])
