"""Tasks for `ngbrain.pool`, importable by the processes that it starts."""

import os
import signal


def lives(answer, *, tell):
    tell("alive")
    return answer


def dies(*, tell):
    os.kill(os.getpid(), signal.SIGKILL)
