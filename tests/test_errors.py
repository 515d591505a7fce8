"""One line for whoever made the mistake: a parameter in Python, a flag on the command line."""

import pickle
from pathlib import Path

import pytest

from link.embed import check_kappa
from link.errors import InputError, ParameterError, at_least, each_once, run_cli
from link.layout import make_layout, read_layout


def printed(error: InputError, capsys: pytest.CaptureFixture[str]) -> str:
    def main() -> None:
        raise error

    with pytest.raises(SystemExit) as stopped:
        run_cli(main)
    assert stopped.value.code == 2
    said = capsys.readouterr()
    assert said.out == ""
    return said.err


@pytest.mark.parametrize(
    ("call", "python", "command"),
    [
        (lambda: check_kappa(0), "kappa: need 1 to 64", "error: --kappa: need 1 to 64"),
        (lambda: check_kappa(0, "--kappas"), "--kappas: need", "error: --kappas: need"),
        (lambda: make_layout(ratex=4), "ratex: choose", "error: --ratex: choose"),
        (lambda: at_least(1, test_frames=0), "test_frames: need", "error: --test-frames: need"),
        (lambda: each_once(views=[1, 1]), "views: name at", "error: --views: name at"),
    ],
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


@pytest.mark.parametrize("text", ["", "{", "[]", '{"rows": 8}', "\xff"])
def test_a_file_without_a_layout_is_named(text: str, tmp_path: Path) -> None:
    path = tmp_path / "layout.json"
    path.write_bytes(text.encode("latin-1"))
    with pytest.raises(InputError, match=r"layout\.json: no layout there"):
        read_layout(path)
    path.unlink()
    with pytest.raises(InputError, match=r"layout\.json: no layout there"):
        read_layout(path)
