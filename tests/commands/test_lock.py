"""The lock on what a command writes: one process at a time, whatever becomes of the others."""

import json
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from conftest import Command, Refuses, cases, files_in, refusal, run_process

import train
from link.errors import InputError
from link.files.lock import LOCK, locked
from link.modules import ROOT
from models import PRETRAINED
from reports.engine.backends import Backend
from reports.engine.predict import predict_all
from reports.engine.stored import resume

HOLD = """
import os, subprocess, sys, time
from pathlib import Path
from link.files.lock import locked
with locked(Path(sys.argv[1]), *sys.argv[2:3]):
    (Path(sys.argv[1]) / f".run.json.{os.getpid()}.tmp").write_bytes(b"half")
    if sys.argv[3:] == ["fork"]:
        if os.fork() == 0:  # the child says so itself, so that it has let go of the lock
            print(os.getpid(), flush=True)
    elif sys.argv[3:] == ["spawn"]:
        print(subprocess.Popen(["sleep", "100"], close_fds=False).pid, flush=True)
    else:
        print("held", flush=True)
    time.sleep(100)
"""


@contextmanager
def holder(folder: Path, *arguments: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """Another process that holds a lock, and what it printed then; it is killed at the end."""
    line = [sys.executable, "-c", HOLD, str(folder), *arguments]
    with subprocess.Popen(line, cwd=ROOT, stdout=subprocess.PIPE, text=True) as process:
        said = process.stdout.readline().strip()
        try:
            yield process, said
        finally:
            process.kill()


def refused(folder: Path, file: str = "") -> str:
    return refusal(locked(folder, file).__enter__)


def refused_elsewhere(folder: Path) -> str:
    """What another process is told that wants the lock."""
    line = "import sys; from pathlib import Path; from link.files.lock import locked\n"
    line += "with locked(Path(sys.argv[1])): pass"
    return run_process(sys.executable, "-c", line, folder, status=1).stderr


def test_a_second_process_is_refused(tmp_path: Path) -> None:
    with holder(tmp_path):
        assert refused(tmp_path).startswith(f"{tmp_path}: another process is writing it; wait")
        with locked(tmp_path / "another"), locked(tmp_path, "film.mkv"):
            pass
    with locked(tmp_path):  # the kernel dropped the lock of the process that was killed
        names = os.listdir(tmp_path)
    assert names.count(LOCK) == 1 and len(names) == 2
    assert os.listdir(tmp_path) == ["another"]  # nor is its temporary file left


NO_PROCESS = 2**31 - 1
"""Number that no process has."""


def test_one_file_of_a_folder_can_be_locked(tmp_path: Path) -> None:
    (tmp_path / f".other.mkv.{NO_PROCESS}.tmp").touch()
    (tmp_path / f".film.mkv.{NO_PROCESS}.tmp.mkv").touch()
    with holder(tmp_path, "film.mkv"):
        assert f"{tmp_path / 'film.mkv'}: another process" in refused(tmp_path, "film.mkv")
        with locked(tmp_path, "other.mkv"):
            pass
    with locked(tmp_path, "film.mkv"):
        assert not (tmp_path / f".film.mkv.{NO_PROCESS}.tmp.mkv").exists()
    assert (tmp_path / f".other.mkv.{NO_PROCESS}.tmp").exists()


def test_what_a_process_that_lives_writes_in_a_subfolder_is_not_removed(tmp_path: Path) -> None:
    names = [f".run.json.{process}.tmp" for process in (os.getppid(), NO_PROCESS)]
    (tmp_path / "sub").mkdir()
    for name in names:
        (tmp_path / "sub" / name).touch()
    (tmp_path / LOCK).touch()
    with locked(tmp_path):
        assert os.listdir(tmp_path / "sub") == names[:1]


def test_a_file_that_was_left_locks_nothing(tmp_path: Path) -> None:
    (tmp_path / LOCK).write_text("1234567\n")
    with locked(tmp_path):
        assert "another process" in refused_elsewhere(tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_lock_that_is_a_link_or_a_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "one").mkdir()
    (tmp_path / "one" / LOCK).symlink_to(tmp_path / "target")
    assert "one: cannot be written" in refused(tmp_path / "one")
    assert not (tmp_path / "target").exists()
    (tmp_path / "two" / LOCK).mkdir(parents=True)
    assert "two: cannot be written" in refused(tmp_path / "two")


def test_a_process_may_take_its_own_lock_again(tmp_path: Path) -> None:
    with locked(tmp_path):
        with locked(tmp_path / "." / ""):
            pass
        assert (tmp_path / LOCK).exists()
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("how", ["fork", "spawn"])
def test_a_child_does_not_keep_the_lock_of_a_parent_that_died(tmp_path: Path, how: str) -> None:
    with holder(tmp_path, "", how) as (process, child):
        assert "another process" in refused(tmp_path)
        process.kill()
        process.wait()
        os.kill(int(child), 0)  # it lives
        try:
            with locked(tmp_path):
                pass
        finally:
            os.kill(int(child), signal.SIGKILL)


def enter_often(folder: Path, times: int) -> None:
    """Enter the folder so many times, and fail where somebody else is in it."""
    entered = 0
    while entered < times:
        try:
            with locked(folder):
                os.close(os.open(folder / "inside", os.O_CREAT | os.O_EXCL))
                time.sleep(0.0005)
                (folder / "inside").unlink()
                entered += 1
        except InputError:
            continue


def test_no_two_processes_are_ever_inside(tmp_path: Path) -> None:
    forked = multiprocessing.get_context("fork")
    processes = [forked.Process(target=enter_often, args=(tmp_path, 40)) for _ in range(4)]
    for process in processes:
        process.start()
    for process in processes:
        process.join(60)
    assert [process.exitcode for process in processes] == [0] * 4
    assert not list(tmp_path.iterdir())


def test_parts_of_runs_refuse_a_folder_that_is_being_written(tmp_path: Path) -> None:
    with holder(tmp_path):
        before = files_in(tmp_path)
        results = tmp_path / "results.jsonl"
        assert "is writing it" in refusal(lambda: predict_all([], [], results, Backend()))
        assert "is writing it" in refusal(lambda: resume(abs, {}, results, Backend(), "title"))
        assert files_in(tmp_path) == before


SEND = f"{ROOT / 'docs' / 'ablation.png'} --message a"
FILM_OF_ONE_FRAME = "--message a --seconds 0.02 --size 160 120"
EVALUATE = "--pairs canon-lg --frames 1 --jobs 1 --views 0 --kappas 5 --methods naive"


@cases(
    ("evaluate", EVALUATE, "run", ""),
    ("train", "--episodes 1 --jobs 1", "run", ""),
    ("lab.__main__", "rates", "run", ""),
    ("data_gen.__main__", "--frames 1", "captures", ""),
    ("data_gen.video", FILM_OF_ONE_FRAME, "film.mkv", "film.jsonl"),
    ("sender.__main__", SEND, "sent.html", "sent.html"),
    ("sender.__main__", SEND, "sent", "sent"),
    ("web.package.__main__", "--only wheel", "packed", ""),
    ("export.to_onnx", "", "decoder.onnx", "decoder.onnx"),
    ("web.__main__", "", "site", "site"),
)
def test_commands_refuse_an_output_that_is_being_written(
    module: str, words: str, out: str, lock: str, tmp_path: Path, refuses: Refuses
) -> None:
    folder = tmp_path if lock else tmp_path / out
    folder.mkdir(exist_ok=True)
    with holder(folder, lock):
        says = f"{folder / lock}: another process is writing it"
        refuses(module, f"{words} --out {tmp_path / out}", says, folder=tmp_path)


# Whose folder it is


OTHER_RUN = "--out: {} holds a run with other settings, or other files; name a new folder"


def test_train_refuses_the_folder_of_another_run_before_any_work(
    tmp_path: Path, command: Command, refuses: Refuses, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulated: list[Path] = []

    def simulate(*_: object) -> None:
        simulated.append(tmp_path)

    def train_and_die(*arguments: object) -> None:
        (Path(str(arguments[3])) / "state.pt").touch()
        raise KeyboardInterrupt

    monkeypatch.setattr(train, "simulate_episodes", simulate)
    monkeypatch.setattr(train, "train", train_and_die)
    flags = ["--episodes", "2", "--rounds", "1", "--out", tmp_path]
    command(train.main, *flags, status=130)
    settings = json.loads((tmp_path / "config.json").read_text())["train"]
    assert (settings["episodes"], settings["pair"]) == (2, "canon-lg")
    command(train.main, *flags, "--jobs", 1, status=130)  # decides nothing
    assert len(simulated) == 2
    for other in (["--seed", 1], ["--frames", 3], ["--pair", "all"], ["--lr", 0.02]):
        refuses("train", [*flags, *other], OTHER_RUN.format(tmp_path), folder=tmp_path)
    refuses("evaluate", ["--out", tmp_path], OTHER_RUN.format(tmp_path), folder=tmp_path)
    assert len(simulated) == 2


@pytest.mark.parametrize("content", ["", "{}", '{"train": 5}'])
def test_train_refuses_a_folder_that_is_not_of_a_training(
    tmp_path: Path, refuses: Refuses, content: str
) -> None:
    (tmp_path / "config.json").write_text(content)
    (tmp_path / "predictions.jsonl").touch()
    refuses("train", ["--out", tmp_path], OTHER_RUN.format(tmp_path), folder=tmp_path)


def test_train_refuses_the_shipped_decoder_of_other_settings(refuses: Refuses) -> None:
    refuses("train", ["--out", PRETRAINED], OTHER_RUN.format(PRETRAINED), folder=PRETRAINED)
