"""What several tests need, made once a session, and one thread for each worker of pytest-xdist."""

import gc
import importlib
import inspect
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import pytest
from filelock import FileLock
from hypothesis import settings

if TYPE_CHECKING:  # imported where they are used: the process that starts the workers needs none
    from playwright.sync_api import Browser, Page
    from port import Port

    from export.runtime import Decoder
    from link.frames import Captured
    from link.layout import Layout
    from link.observation import Observation

ROOT = Path(__file__).parents[1]
"""Folder of the repository."""

# The same examples on every machine, and fewer than the usual 100 where a test names no number.
settings.register_profile("suite", deadline=None, derandomize=True, max_examples=40)
settings.load_profile("suite")

# The suite's tensors are small, and its workers share the cores. torch, OpenCV and NumPy read
# these when they are first imported, here and in the processes that tests start.
for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "OPENCV_FOR_THREADS_NUM"):
    os.environ[variable] = "1"

# Tests start about a hundred processes, which need not all compile the same modules.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Import the tests without the garbage collector, which then leaves what is there alone.

    The collector would visit a million objects of libraries again and again, which stay anyway.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def slow(*values: object) -> Any:
    """A case of a parametrised test that the default run leaves out."""
    return pytest.param(*values, marks=pytest.mark.slow)


def exhaustive(*values: object) -> Any:
    """A case of a parametrised test that is left to the workflow of GitHub."""
    return pytest.param(*values, marks=pytest.mark.exhaustive)


def cases(*rows: Any, ids: Any = None) -> Callable[..., Any]:
    """Run a test once with each row of a table; its first parameters take a row's values.

    A row is a tuple, or what the test's first parameter takes. A row of `slow` or `exhaustive` is
    one, too.
    """
    first = rows[0].values if isinstance(rows[0], type(pytest.param())) else rows[0]
    count = len(first) if isinstance(first, tuple) else 1

    def run_with_each(test: Callable[..., Any]) -> Callable[..., Any]:
        names = list(inspect.signature(test).parameters)[:count]
        return pytest.mark.parametrize(names if count > 1 else names[0], rows, ids=ids)(test)

    return run_with_each


CORE = tuple(
    f"tests/{name}" for name in ("models/", "data_gen/", "reports/", "commands/test_train")
)
"""Where the tests lie of what research changes: decoders, simulation, training and comparison."""


@pytest.hookimpl(tryfirst=True)  # before pytest selects by markers
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark tests by what they need and where they lie, and begin with what takes longest.

    So no worker is left with that at the end: the commands of the README, exports, and what waits
    for the trained decoder.
    """
    for item in items:
        fixtures = getattr(item, "fixturenames", ())
        marks = {mark.name for mark in item.iter_markers()}
        if {"node", "chromium"} & set(fixtures):
            item.add_marker("page")
        elif item.nodeid.startswith(CORE) and not marks & {"slow", "exhaustive"}:
            item.add_marker("core")
    long = ("commands_of_the_readme", "exported_graph", "test_train", "trained")
    items.sort(key=lambda item: not any(name in item.nodeid for name in long))


def lacking(what: str, reason: str) -> NoReturn:
    """Skip a test for something that this machine lacks, or fail where it is required.

    The environment variable OORC_REQUIRE names what is: node, chromium, or both.
    """
    if what in os.environ.get("OORC_REQUIRE", "").split():
        pytest.fail(f"{reason}, and OORC_REQUIRE says that {what} must be there")
    pytest.skip(reason)


@pytest.fixture(scope="session")
def layout() -> "Layout":
    from link.layout import make_layout

    return make_layout()


@pytest.fixture(scope="session")
def captured(layout: "Layout") -> "Captured":
    """One simulated frame pair, canon-lg, 45 degrees, kappa 5."""
    from data_gen.frame_pair import Cell, FramePair, Source

    return FramePair(Source(layout), Cell("canon-lg", 45.0, 5), 0).captured


@pytest.fixture(scope="session")
def rectified(captured: "Captured") -> "Observation":
    return captured.rectified()


# Folders that take long to make

MakeOnce = Callable[[str, Callable[[Path], None]], Path]


@pytest.fixture(scope="session")
def make_once(tmp_path_factory: pytest.TempPathFactory, worker_id: str) -> MakeOnce:
    """Make a folder once for all workers, which then only read it.

    Called with the folder's name and a function that fills an empty folder. The first worker that
    asks fills it, and the others wait for it.
    """
    base = tmp_path_factory.getbasetemp()
    if worker_id != "master":
        base = base.parent  # a worker's own folder lies within that of the session

    def make(name: str, fill: Callable[[Path], None]) -> Path:
        folder, finished = base / name, base / f"{name}.finished"
        with FileLock(base / f"{name}.lock"):
            if not finished.exists():
                shutil.rmtree(folder, ignore_errors=True)  # what another worker failed to make
                folder.mkdir()
                fill(folder)
                finished.touch()
        return folder

    return make


TINY = ["--pair", "canon-lg", "--episodes", "6", "--rounds", "2", "--steps", "3", "--lr", "0.1"]
TINY += ["--frames", "1", "--jobs", "1"]


@pytest.fixture(scope="session")
def run_folder(make_once: MakeOnce) -> Path:
    """What train.py leaves behind; every parameter has moved by up to half."""

    def fill(folder: Path) -> None:
        import train  # seconds, which most tests need not wait for

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("export.to_onnx.PARITY_FRAMES", 6)  # test_export has others
            run_main(train.main, *TINY, "--out", folder)

    return make_once("canon-lg", fill)


@pytest.fixture(scope="session", params=["shipped", exhaustive("trained")])
def checkpoint(request: pytest.FixtureRequest) -> Path:
    """Folder of a decoder: the shipped one, and one whose every parameter has moved."""
    from models import PRETRAINED

    if request.param == "shipped":
        return PRETRAINED
    folder: Path = request.getfixturevalue("run_folder")
    return folder


@pytest.fixture(scope="session")
def onnx_decoder(checkpoint: Path) -> "Decoder":
    from export.runtime import Decoder

    return Decoder(checkpoint / "decoder.onnx")


# Commands


@dataclass(frozen=True)
class Finished:
    """What a command left behind."""

    status: int
    stdout: str
    stderr: str


Command = Callable[..., Finished]


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Command:
    """Run a script's ``main`` in this process, as its last two lines do.

    It must end with ``status``; where this is None, it may end with any.
    """

    from link.cli import run_cli

    def run(main: Callable[[], None], *arguments: object, status: int | None = 0) -> Finished:
        monkeypatch.setattr(sys, "argv", ["program", *map(str, arguments)])
        monkeypatch.setenv("OORC_MAX_MEGAPIXELS", "50")  # what --max-megapixels sets is undone
        capfd.readouterr()
        code = 0
        try:
            run_cli(main)
        except SystemExit as end:
            code = int(end.code or 0)
        done = Finished(code, *capfd.readouterr())
        assert status in (code, None), done.stderr
        return done

    return run


def run_main(main: Callable[[], None], *words: object) -> None:
    """Run a script's ``main`` with the words of a command line, for fixtures of a whole module."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", [f"{main.__module__}.py", *map(str, words)])
        main()


def run_process(
    *words: object, status: int | None = 0, cwd: Path = ROOT, limit_s: float = 300, **more: Any
) -> Finished:
    """Run a program in a process of its own, with some ``more`` variables of the environment.

    It must end with ``status``; where this is None, it may end with any. A variable that is None is
    taken out of the environment.
    """
    line, variables = [*map(str, words)], {**os.environ, **more}
    variables = {name: value for name, value in variables.items() if value is not None}
    ended = subprocess.run(
        line, cwd=cwd, env=variables, capture_output=True, text=True, timeout=limit_s
    )
    assert status in (ended.returncode, None), ended.stdout[-2000:] + ended.stderr[-2000:]
    return Finished(ended.returncode, ended.stdout, ended.stderr)


def refusal(call: Callable[[], object]) -> str:
    """What the `InputError` says that a call must raise: one line."""
    from link.errors import InputError

    with pytest.raises(InputError) as error:
        call()
    said = str(error.value)
    assert said and "\n" not in said
    return said


def files_in(folder: Path) -> dict[Path, bytes]:
    """Content of every file of a folder, hidden ones included."""
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


Refuses = Callable[..., str]


@pytest.fixture
def refuses(command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Refuses:
    """Run a command that must refuse what it is given, and return the line that it says.

    Called with the command's module, the words of its command line, as a text or one by one, and
    what the line must say. The exit status must be 2, stderr must hold one line and stdout
    nothing. The command runs in ``folder``, by default the test's own, whose files must be as
    before. Where work ``began`` before the refusal, there may be other output before the line.
    """

    def run(
        module: str,
        words: str | Sequence[object],
        *says: str,
        began: bool = False,
        folder: Path = tmp_path,
    ) -> str:
        monkeypatch.chdir(folder)
        before = files_in(folder)
        main = importlib.import_module(module).main
        words = words.split() if isinstance(words, str) else words
        done = command(main, *words, status=2)
        assert "Traceback" not in done.stderr
        line = done.stderr.splitlines()[-1]
        if not began:
            assert (done.stderr, done.stdout) == (f"{line}\n", "")
        assert line.startswith("error: ")
        for part in says:
            assert part in line
        assert files_in(folder) == before
        return line

    return run


# Node.js and a browser


@pytest.fixture(scope="session")
def node() -> None:
    """What needs Node.js and the page's packages; tests that do are skipped where there is none."""
    if shutil.which("node") is None or not (ROOT / "web" / "node_modules").is_dir():
        lacking("node", "needs Node.js, and `npm ci` in web")
    from web.host.constants import write_constants

    write_constants()


@pytest.fixture(scope="session")
def node_process(node: None) -> "Iterator[Port]":
    from port import Port

    process = Port()
    yield process
    process.close()


@pytest.fixture
def port(node_process: "Port") -> "Iterator[Port]":
    """The page's JavaScript; objects that a test makes there are forgotten after it."""
    yield node_process
    node_process.ask(None)


@pytest.fixture(scope="session")
def site(node: None, make_once: MakeOnce) -> Path:
    """Folder of the page, built once a session."""
    from web.host.site import build_site

    return make_once("site", lambda empty: build_site(empty / "web")) / "web"


@pytest.fixture(scope="session")
def npm_package(node: None, make_once: MakeOnce) -> Path:
    """Folder node_modules with the npm package, beside what npm would install with it."""
    from test_npm import install_package

    return make_once("npm_package", install_package) / "node_modules"


@pytest.fixture(scope="session")
def chromium() -> str:
    """Path of the machine's Chromium; tests that need it are skipped where there is none."""
    from browser import BROWSERS, find_browser

    executable = find_browser()
    if executable is None:
        lacking("chromium", f"needs a browser: found none of {', '.join(BROWSERS)}")
    return executable


@pytest.fixture(scope="module")
def browser(chromium: str) -> "Iterator[Browser]":
    """A browser without a window.

    One for each module, not for the session: Playwright keeps an event loop in this thread while it
    runs, and Dask's tests should not meet it.
    """
    from browser import BROWSER_FLAGS
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=chromium, args=BROWSER_FLAGS)
        yield running
        running.close()


OpenWindow = Callable[..., "Page"]


@pytest.fixture
def open_window(browser: "Browser") -> Iterator[OpenWindow]:
    """Open a window of ``width`` by ``height`` CSS pixels, which is closed after the test.

    ``ratio`` is the number of device pixels to a CSS pixel, and ``mobile`` lays pages out as a
    phone does.
    """
    contexts = []

    def open_it(width: int, height: int, ratio: float = 1, mobile: bool = False) -> "Page":
        context = browser.new_context(
            viewport={"width": width, "height": height},
            device_scale_factor=ratio,
            is_mobile=mobile,
        )
        contexts.append(context)
        return context.new_page()

    yield open_it
    for context in contexts:
        context.close()
