"""Ctrl-C ends a command in any state: during imports, and in work that does not return to Python."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from ngbrain.cli import interrupts

WORK = """
import hashlib, os, signal, sys, time
from types import SimpleNamespace
from ngbrain import cli
from ngbrain.cli import interrupts

signal.signal(signal.SIGINT, signal.default_int_handler)  # a background job of a shell begins without

def sleep(_):
    print("begun", flush=True)
    time.sleep(60)

def deaf(_):
    print("begun", flush=True)
    hashlib.pbkdf2_hmac("sha256", b"", b"", 10**9)

def broken(_):
    try:
        sleep(_)
    except KeyboardInterrupt:
        raise ImportError("initialization failed") from None

def swallowed(_):
    try:
        sleep(_)
    except KeyboardInterrupt:
        time.sleep(60)

interrupts.GRACE = float(sys.argv[2])
cli.import_module = lambda _: SimpleNamespace(run=globals()[sys.argv[1]])
sys.exit(cli.main(["simulate", "scene.toml", "-o", "there"]))
"""


def interrupted(work, grace, times):
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[1])}
    command = [sys.executable, "-c", WORK, work, str(grace)]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    ) as process:
        try:
            assert process.stdout.readline() == "begun\n"
            time.sleep(0.1)
            for _ in range(times):
                process.send_signal(signal.SIGINT)
                time.sleep(0.3)
            error = process.communicate(timeout=30)[1]
        finally:
            process.kill()
    assert process.returncode == 130 and error == "ngbrain: stopped; continue with --resume -o there\n"


@pytest.mark.parametrize(
    ("work", "grace", "times"),
    [("sleep", 60, 1), ("broken", 60, 1), ("deaf", 0.5, 1), ("deaf", 60, 2), ("swallowed", 0.5, 1)],
)
def test_ctrl_c(work, grace, times):
    interrupted(work, grace, times)


@pytest.fixture
def heard():
    """Enable Ctrl-C, also where the tests themselves run in the background of a shell."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def test_nothing_is_left_of_it(heard):
    handler = signal.getsignal(signal.SIGINT)
    with interrupts.interruptible("stopped"):
        assert signal.getsignal(signal.SIGINT) != handler
    assert signal.getsignal(signal.SIGINT) == handler and signal.set_wakeup_fd(-1) == -1
    with pytest.raises(ZeroDivisionError), interrupts.interruptible("stopped"):
        1 / 0  # noqa: B018


def test_a_background_job_of_a_shell_does_not_hear_it(monkeypatch):
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with interrupts.interruptible("stopped"):
            assert signal.getsignal(signal.SIGINT) == signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)
