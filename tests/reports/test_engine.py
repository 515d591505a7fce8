"""The same bytes from one process, two, two Dask workers, and a run that was killed."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import distributed
import pytest
import torch
from conftest import Command, MakeOnce, cases, run_main
from threadpoolctl import threadpool_info, threadpool_limits

import evaluate
from data_gen.frame_pair import Cell, Source
from link.errors import InputError
from link.layout import make_layout
from link.modules import ROOT, imported_modules
from reports.engine import backends
from reports.engine import predict as engine
from reports.engine.backends import Backend, make_backend, one_thread, run_tasks
from reports.engine.checked import read_sealed
from reports.engine.digest import DATA, code_digest, file_digest
from reports.engine.methods import Method
from reports.engine.predict import Condition, checkpoint_digest, fingerprint, predict, predict_all

RUN = ["--pairs", "canon-lg", "--views", "0", "45", "--kappas", "5", "--frames", "1"]
RUN += ["--methods", "oorc", "learned", "hidden_ratex", "--no-html"]
N_CELLS, N_METHODS = 2, 3
GOOD, BAD = Cell("canon-lg", 0.0, 5), Cell("canon-lg", 0.0, 0)  # there is no kappa of 0
NAIVE = [Method("naive")]


def condition(*cells: Cell, source: Source | None = None) -> list[Condition]:
    """One frame pair of each cell."""
    return [Condition("", source or Source(make_layout()), cells, 1)]


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    """Address of a Dask cluster of two worker processes."""
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=":0", silence_logs=50
    ) as cluster:
        yield cluster.scheduler_address


@pytest.fixture(scope="module")
def alone(make_once: MakeOnce) -> Path:
    """The run by one process."""

    def fill(out: Path) -> None:
        run_main(evaluate.main, *RUN, "--jobs", 1, "--out", out)

    return make_once("alone", fill)


def results(folder: Path) -> tuple[bytes, bytes, Any]:
    """Everything a run writes, but its command line."""
    metrics = json.loads((folder / "metrics.json").read_text())
    metrics["meta"].pop("command")
    return (folder / "predictions.jsonl").read_bytes(), (folder / "tables.md").read_bytes(), metrics


@pytest.mark.slow
def test_two_processes_write_the_bytes_of_one(
    alone: Path, tmp_path: Path, command: Command
) -> None:
    command(evaluate.main, *RUN, "--jobs", 2, "--out", tmp_path)
    assert results(tmp_path) == results(alone)


@pytest.mark.exhaustive
def test_two_dask_workers_write_the_bytes_of_one_process(
    alone: Path, tmp_path: Path, command: Command, scheduler: str
) -> None:
    dask = ("--backend", "dask", "--scheduler", scheduler)
    command(evaluate.main, *RUN, *dask, "--out", tmp_path)
    assert results(tmp_path) == results(alone)
    with distributed.Client(scheduler, set_as_default=False) as client:
        loaded = client.run(lambda: "reports.engine.predict" in sys.modules)
    assert list(loaded.values()) == [True, True]  # both took part


@pytest.mark.slow
def test_a_killed_run_goes_on_to_the_same_bytes(
    alone: Path, tmp_path: Path, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    part = tmp_path / "predictions.jsonl.part"
    line = [sys.executable, "evaluate.py", *RUN, "--jobs", "1", "--out", str(tmp_path)]
    with subprocess.Popen(
        line, cwd=ROOT, start_new_session=True, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
    ) as run:
        started = time.monotonic()
        while not read_sealed(part) and time.monotonic() < started + 60:
            time.sleep(0.005)
        os.killpg(run.pid, signal.SIGKILL)
        assert run.wait() == -signal.SIGKILL
    kept = read_sealed(part)
    assert 1 <= len(kept) < N_CELLS
    assert not (tmp_path / "predictions.jsonl").exists()
    decoded = []

    def noted(task: engine.Task) -> Any:
        decoded.extend((task.cell, method.label) for method in task.methods)
        return decode_cell(task)

    decode_cell = engine.decode_cell
    monkeypatch.setattr(engine, "decode_cell", noted)
    command(evaluate.main, *RUN, "--jobs", 1, "--out", tmp_path)
    assert results(tmp_path) == results(alone)
    assert len(decoded) == (N_CELLS - len(kept)) * N_METHODS  # what is kept is not decoded again
    assert not part.exists()


@pytest.mark.slow
def test_a_failing_cell_is_reported_and_the_others_are_written(
    alone: Path, tmp_path: Path, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    def failing(task: Any) -> Any:
        if task.cell == Cell("canon-lg", 45.0, 5):
            raise ZeroDivisionError("made to\nfail")
        return decode_cell(task)

    decode_cell = engine.decode_cell
    run = (*RUN, "--jobs", 1, "--out", tmp_path)
    with monkeypatch.context() as patch:
        patch.setattr(engine, "decode_cell", failing)
        done = command(evaluate.main, *run, status=2)
    report, last = done.stderr.splitlines()[-2:]
    assert report.startswith(
        "failed: canon-lg, 45°, kappa 5: ZeroDivisionError: made to fail (" + str(tmp_path)
    )
    assert last.startswith("error: 1 ")
    assert "cells failed, as listed above" in last
    trace = Path(report.rpartition("(")[2].rstrip(")"))
    assert "Traceback" in trace.read_text()
    assert "failing" in trace.read_text()
    _, _, metrics = results(tmp_path)
    assert len(metrics["meta"]["failed_cells"]) == 1
    rows = results(alone)[2]["rows"]
    assert metrics["rows"] == [row for row in rows if row["view_deg"] == 0.0]
    assert len(metrics["rows"]) == N_METHODS

    command(evaluate.main, *run)  # mended, it is tried again
    assert results(tmp_path) == results(alone)
    assert not trace.exists()


@pytest.mark.slow
def test_a_cell_that_fails_elsewhere_is_reported_too(tmp_path: Path) -> None:
    predicted = predict(condition(BAD, GOOD), NAIVE, tmp_path / "a.jsonl", Backend(2))
    assert predicted.records["kappa"].tolist() == [5]
    (report,) = predicted.failed
    assert report.startswith("canon-lg, 0°, kappa 0: kappa: need 1 to 64")


def test_commands_that_need_every_cell_refuse_to_go_on(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="1 of 2 cells failed: canon-lg, 0°, kappa 0: kappa"):
        predict_all(condition(BAD, GOOD), NAIVE, tmp_path / "a.jsonl", Backend())
    with pytest.raises(InputError, match=r"^kappa: need 1 to 64"):
        predict_all(condition(BAD), NAIVE, tmp_path / "b.jsonl", Backend())


@pytest.mark.slow
def test_a_task_whose_process_dies_fails_alone() -> None:
    def task(number: int) -> int:
        if number == 1:
            os._exit(1)
        return number * number

    outcomes = sorted(run_tasks(task, range(4), Backend(2)), key=lambda o: o.index)
    assert [outcome.result for outcome in outcomes] == [0, None, 4, 9]
    assert outcomes[1].reason.startswith("TerminatedWorkerError: ")


@pytest.mark.slow
def test_a_worker_with_other_code_is_refused(
    tmp_path: Path, scheduler: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(engine, "fingerprint", lambda *_: "another checkout")
    with pytest.raises(InputError, match="has other code, packages, checkpoints or pictures"):
        predict(condition(GOOD), NAIVE, tmp_path / "a.jsonl", Backend(scheduler=scheduler))


def test_the_fingerprint_knows_what_decides(tmp_path: Path) -> None:
    source, naive = Source(make_layout()), NAIVE[0]
    (usual,), own = condition(GOOD), tmp_path / "mine.json"
    marks = {
        fingerprint(usual, naive),
        fingerprint(replace(usual, frames=usual.frames + 1), naive),
        fingerprint(replace(usual, source=replace(source, seed=1)), naive),
        fingerprint(usual, Method("naive", (("threshold", 2.5),))),
        fingerprint(usual, Method("oorc")),
    }
    for drift in (0.1, 0.2):  # what a file of a pair says decides, too
        own.write_text(json.dumps({"base": "canon-lg", "set": {"drift": drift}}))
        mine = replace(usual, cells=(Cell(str(own), 0.0, 3),))
        marks.add(fingerprint(mine, naive))
    assert len(marks) == 7
    assert fingerprint(usual, Method("naive", label="another name")) in marks
    assert checkpoint_digest(Method("learned"), make_layout()) not in ("", file_digest([]))


def test_a_method_that_is_new_costs_no_other_its_results(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "predictions.jsonl"
    predict_all(condition(GOOD), NAIVE, file, Backend())
    before = file.read_bytes()
    decoded = []

    def noted(task: engine.Task) -> Any:
        decoded.append([method.label for method in task.methods])
        return decode_cell(task)

    decode_cell = engine.decode_cell
    monkeypatch.setattr(engine, "decode_cell", noted)
    records = predict_all(condition(GOOD), [*NAIVE, Method("oorc")], file, Backend())
    assert records["method"].tolist() == ["naive", "oorc"]
    assert decoded == [["oorc"]]
    assert file.read_bytes().startswith(before)


# What decides a result


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A small checkout: a decoder that imports a helper, and a player that nothing imports."""
    files = {
        "link/__init__.py": "",
        "link/used.py": '"""A helper."""\n\nFACTOR = 2\n',
        "link/player.py": "SPEED = 1\n",
        "models/__init__.py": "",
        "models/decoder.py": "from link import used\n\n\ndef f(x):\n    return used.FACTOR * x\n",
    }
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    return tmp_path


def digest_after(checkout: Path, name: str, text: str) -> str:
    (checkout / name).write_text(text)
    code_digest.cache_clear()
    return code_digest("models.decoder", root=checkout)


def test_what_is_not_run_decides_nothing(checkout: Path) -> None:
    before = code_digest("models.decoder", root=checkout)
    assert before == digest_after(checkout, "link/player.py", "SPEED = 3\n")
    commented = '"""Another docstring."""\n\n# why\nFACTOR = 2\n"""Said anew."""\n'
    assert before == digest_after(checkout, "link/used.py", commented)


@cases(
    ("link/used.py", "FACTOR = 3\n"),
    ("models/decoder.py", "from link import used\n\n\ndef f(x):\n    return used.FACTOR + x\n"),
    ("models/decoder.py", "def f(x):\n    return 2 * x\n"),
)
def test_what_is_run_decides(name: str, text: str, checkout: Path) -> None:
    assert code_digest("models.decoder", root=checkout) != digest_after(checkout, name, text)


@pytest.mark.slow
def test_a_decoder_runs_on_what_it_imports_and_not_on_the_player() -> None:
    modules = imported_modules(["data_gen.frame_pair", "models.phi.methods"])
    assert {"models.phi.solver", "link.ratex", "data_gen.parameters"} <= set(modules)
    assert not [name for name in modules if name.split(".")[0] in ("export", "reports")]
    assert set(DATA) <= set(modules)
    assert all((ROOT / name).is_file() for names in DATA.values() for name in names)


# Flags


@cases(
    ("dask", None, "--backend dask: give --scheduler"),
    ("loky", "tcp://host:8786", "--scheduler: needs --backend dask"),
)
def test_flags_that_clash(name: str, scheduler: str | None, message: str) -> None:
    with pytest.raises(InputError, match=message):
        make_backend(name, 1, scheduler)


def no_tasks(scheduler: str) -> None:
    list(run_tasks(abs, [], Backend(scheduler=scheduler)))


def test_something_else_listens(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(backends, "CONNECT_S", 0.5)
    with (
        socket.create_server(("127.0.0.1", 0)) as silent,
        pytest.raises(InputError, match="does not answer"),
    ):
        no_tasks(f"tcp://127.0.0.1:{silent.getsockname()[1]}")


@cases("nonsense", "tcp://host", "tcp://host:99999", "tcp://127.0.0.1:9")
def test_an_address_where_no_scheduler_is(address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(backends, "CONNECT_S", 0.5)
    said = f"--scheduler: no Dask scheduler at '{address}'; need an address such as tcp://host:8786"
    with pytest.raises(InputError, match=said):
        no_tasks(address)


@pytest.mark.slow
def test_a_scheduler_without_workers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(backends, "CONNECT_S", 0.5)
    with (
        distributed.LocalCluster(n_workers=0, dashboard_address=":0") as cluster,
        pytest.raises(InputError, match="has no worker after"),
    ):
        no_tasks(cluster.scheduler_address)


def test_dask_is_optional(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"pip install -e '\.\[dask\]'"):
        no_tasks("tcp://127.0.0.1:8786")


def test_one_thread_holds_every_pool() -> None:
    with threadpool_limits(2):
        cv2.setNumThreads(2)
        torch.set_num_threads(2)
        one_thread()
        assert cv2.getNumThreads() == torch.get_num_threads() == 1
        assert {pool["num_threads"] for pool in threadpool_info()} == {1}
