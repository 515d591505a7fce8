"""One line for whoever made the mistake: a parameter in Python, a flag on the command line."""

import pickle
import subprocess
import sys
from pathlib import Path

import cv2
import pytest
from conftest import ROOT, cases, run_process

from link.cli import run_cli
from link.embed import check_kappa
from link.errors import InputError, ParameterError, at_least, each_once
from link.layout import make_layout


def printed(error: BaseException, capsys: pytest.CaptureFixture[str]) -> str:
    def main() -> None:
        raise error

    with pytest.raises(SystemExit) as stopped:
        run_cli(main)
    assert stopped.value.code == 2
    said = capsys.readouterr()
    assert said.out == ""
    return said.err


@cases(
    (lambda: check_kappa(0), "kappa: need 1 to 64", "error: --kappa: need 1 to 64"),
    (lambda: check_kappa(0, "--kappas"), "--kappas: need", "error: --kappas: need"),
    (lambda: make_layout(ratex=4), "ratex: choose", "error: --ratex: choose"),
    (lambda: at_least(1, test_frames=0), "test_frames: need", "error: --test-frames: need"),
    (lambda: each_once(views=[1, 1]), "views: name at", "error: --views: name at"),
    ids=["kappa", "named by its caller", "ratex", "at_least", "each_once"],
)
def test_python_reads_of_parameters_and_the_command_line_of_flags(
    call: object, python: str, command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert callable(call)
    with pytest.raises(ParameterError) as raised:
        call()
    assert str(raised.value).startswith(python)
    assert printed(raised.value, capsys).startswith(command)


@cases(
    (OSError(28, "No space left on device"), "the output or a file: No space left on device"),
    (FileNotFoundError(2, "No such file", "a\nb.txt"), "a b.txt: No such file"),
    (FileNotFoundError(2, "No such file", "κ\x1b[31m\udcff"), "κ\\x1b[31m\\udcff: No such"),
    (OSError(36, "File name too long", "n" * 300), f"{'n' * 300}: File name too long"),
    (MemoryError("Unable to allocate 112 GiB"), "too little memory; use smaller sizes"),
    (cv2.error("(-4:Insufficient memory) Failed to allocate"), "too little memory; use"),
    (RuntimeError("DefaultCPUAllocator: can't allocate memory"), "too little memory; use"),
)
def test_what_the_system_refuses_is_one_line(
    error: Exception, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    message = printed(error, capsys)
    assert message.startswith(f"error: {said}")
    assert message.count("\n") == 1


def test_other_errors_of_libraries_are_not_hidden() -> None:
    def main() -> None:
        raise RuntimeError("a mistake of ours")

    with pytest.raises(RuntimeError, match="a mistake of ours"):
        run_cli(main)


def test_a_terminal_without_the_characters_of_an_output_gets_escapes() -> None:
    script = "from link.cli import run_cli; run_cli(lambda: print('κ', chr(0xdcff)))"
    for encoding, said in (("ascii", "\\u03ba"), ("utf-8:strict", "κ")):
        done = run_process(sys.executable, "-c", script, PYTHONIOENCODING=encoding)
        assert (done.stdout, done.stderr) == (f"{said} \\udcff\n", "")


PRINTS_FOR_EVER = """
from link.cli import run_cli
def main():
    while True:
        print("a line of output")
run_cli(main)
"""


def test_a_reader_that_leaves_ends_the_command_in_silence() -> None:
    with subprocess.Popen(
        [sys.executable, "-c", PRINTS_FOR_EVER],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    ) as process:
        process.stdout.readline()
        process.stdout.close()
        assert process.stderr.read() == b""
        assert process.wait(20) == 141


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs Linux's /dev/full")
@pytest.mark.parametrize("script", [PRINTS_FOR_EVER, PRINTS_FOR_EVER.replace("while", "if")])
def test_a_full_device_is_named_in_one_line(script: str) -> None:
    line = '"$0" -c "$1" > /dev/full'
    done = run_process("sh", "-c", line, sys.executable, script, status=2)
    assert done.stderr == "error: the output or a file: No space left on device\n"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs Linux's /dev/full")
@cases(("> /dev/full", 2), (">&-", 0), ("| true", 0))
@pytest.mark.parametrize("words", ["--help", "gone.png"])
def test_a_command_with_an_output_that_takes_nothing(
    redirected: str, status: int, words: str
) -> None:
    line = f"{sys.executable} -m receiver.locate {words} {redirected}"
    done = run_process("sh", "-c", line, status=None)
    if words != "--help":
        assert done.stderr == "error: gone.png: no such image file; check the path\n"
    elif status:
        assert done.stderr == "error: the output or a file: No space left on device\n"
    else:
        assert done.stderr == ""
    if redirected != "| true":
        assert done.status == (status if words == "--help" else 2)


def test_an_error_that_names_no_parameter_is_printed_as_it_is(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert printed(InputError("photo.png: no image\nat all"), capsys) == (
        "error: photo.png: no image at all\n"
    )


def test_a_parameters_error_crosses_from_process_to_process() -> None:
    error = pickle.loads(pickle.dumps(ParameterError("kappa", "too large")))
    assert (type(error), error.parameter, str(error)) == (
        ParameterError,
        "kappa",
        "kappa: too large",
    )
