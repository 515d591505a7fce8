"""The documents: links lead somewhere, commands exist, and code runs from the first block on."""

import re
import shutil
import sys
from collections import defaultdict
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT, run_process

from lab.__main__ import STUDIES
from link import __version__
from link.images import write_image
from link.images.files import read_image

BLOCK = re.compile(r"^```python\n(.*?)^```$", re.DOTALL | re.MULTILINE)
LINK = re.compile(r"\]\(((?!https?:)[^)\s]+)\)")
COMMAND = re.compile(r"python -m ([a-z_][\w.]*\w)")
HEADING = re.compile(r"^#+ (.+)$", re.MULTILINE)
SHELL = re.compile(
    r"(?:python3? |`)(?:-m (lab [a-z_]+|[a-z_][\w.]*\w)|(evaluate|train)\.py)([^`\n]*)"
)
FLAG = re.compile(r"(?<= )--(?:[a-z][a-z0-9.-]*)")
DIFF = re.compile(r"^```diff\n# (\S+)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
PAGES = [
    *(ROOT / f"{name}.md" for name in ("README", "CHANGELOG", "CONTRIBUTING")),
    *sorted((ROOT / "docs").glob("*.md")),
]
SHOWN = {file: BLOCK.findall(file.read_text()) for file in sorted((ROOT / "docs").glob("*.md"))}
del SHOWN[ROOT / "docs" / "embed.md"]  # tests/web/test_package.py runs it without the checkout
CITATION = (ROOT / "CITATION.cff").read_text("utf-8")
TAG = "results-2026-11"
"""Tag of the commit that measured what the repository no longer measures."""
FOREIGN = ("venv", "pip", "http.server")
"""Modules of Python's own that the documents run."""


def anchors(page: Path) -> set[str]:
    """Names by which links reach the headings of a page, as GitHub makes them."""
    words = [
        re.sub(r"[^\w\- ]", "", heading.lower()) for heading in HEADING.findall(page.read_text())
    ]
    return {each.strip().replace(" ", "-") for each in words}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_link_of_a_page_leads_to_a_file_and_a_heading(page: Path) -> None:
    for link in LINK.findall(page.read_text()):
        name, _, anchor = link.partition("#")
        file = page.parent / name if name else page
        assert file.is_file(), link
        assert not anchor or anchor in anchors(file), link


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_command_exists(page: Path) -> None:
    text = page.read_text("utf-8")
    missing = {name for name in COMMAND.findall(text) if not is_command(name)}
    assert not missing or TAG in text, f"{page.name}: no module {sorted(missing)}"
    assert set(re.findall(r"python -m lab ([a-z_]+)", text)) <= set(STUDIES), page.name


def shown_flags() -> dict[str, set[str]]:
    """Flags that the pages show, by the command that gets them, such as "lab rates"."""
    found: defaultdict[str, set[str]] = defaultdict(set)
    for page in PAGES:
        text = re.sub(r"\\\n", " ", page.read_text("utf-8"))
        text = re.sub(r"(?<=[^`\n])\n(?=[^`\n]+`[^`])", " ", text)  # code that breaks in a line
        for module, script, rest in SHELL.findall(text):
            name = module or script
            if name not in FOREIGN and TAG not in rest:
                found[name] |= set(FLAG.findall(rest))
    return {name: flags for name, flags in found.items() if flags}


@pytest.mark.slow
def test_every_flag_that_a_page_shows_is_in_the_help_of_its_command(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    flags = shown_flags()
    assert {"evaluate", "train", "sender", "receiver", "data_gen.video", "lab rates"} <= set(flags)
    for name, shown in flags.items():
        module, *study = name.split()
        monkeypatch.setattr(sys, "argv", [name, *study, "--help"])
        entry = module if not (ROOT / module.replace(".", "/")).is_dir() else f"{module}.__main__"
        with pytest.raises(SystemExit):
            import_module(entry).main()
        missing = shown - set(re.findall(r"--[a-z][a-z0-9.-]*", capsys.readouterr().out))
        assert not missing, f"{name}: the pages show {sorted(missing)}"


def is_command(name: str) -> bool:
    """Whether a module that can be run has this name."""
    path = ROOT / name.replace(".", "/")
    return name in FOREIGN or path.with_suffix(".py").is_file() or (path / "__main__.py").is_file()


def test_the_rates_of_the_readme_are_those_of_the_docs() -> None:
    quoted = re.findall(r"\d+ of \d+", (ROOT / "README.md").read_text("utf-8"))
    assert quoted
    pages = [(ROOT / "docs" / f"{name}.md").read_text("utf-8") for name in ("hidden", "receiver")]
    assert not [rate for rate in quoted if not any(rate in page for page in pages)]


def test_the_frozen_commands_are_gone() -> None:
    answered = (ROOT / "docs" / "answered.md").read_text("utf-8")
    frozen = set(re.findall(r"`(reports\.[\w.]+)`", answered))
    assert len(frozen) >= 5
    assert not [name for name in frozen if is_command(name)]


@pytest.mark.slow
@pytest.mark.parametrize(
    "file", [file for file, found in SHOWN.items() if found], ids=lambda f: f.name
)
def test_the_code_of_a_document_runs(file: Path, tmp_path: Path) -> None:
    """In a process and a folder of its own, where a document may write files and import them."""
    (tmp_path / "script.py").write_text("\n".join(SHOWN[file]))
    variables = {"PYTHONPATH": str(ROOT), "MPLBACKEND": "Agg"}
    run_process(sys.executable, "script.py", cwd=tmp_path, **variables)


def applied(diff: str, text: str) -> str:
    """A text with the lines of a diff put in, which stand there once without them."""
    lines = diff.splitlines(keepends=True)
    before = "".join(line[1:] for line in lines if line[0] in " -")
    after = "".join(line[1:] for line in lines if line[0] in " +")
    assert text.count(before) == 1, before
    return text.replace(before, after)


@pytest.mark.slow
def test_the_effect_that_the_docs_add_works(tmp_path: Path) -> None:
    for folder in ("data_gen", "link"):
        shutil.copytree(ROOT / folder, tmp_path / folder)
    diffs = DIFF.findall((ROOT / "docs" / "extend.md").read_text())
    assert len(diffs) == 3
    for name, diff in diffs:
        file = tmp_path / name
        file.write_text(applied(diff, file.read_text()))
    run = "sys.argv[1:] = '--view 45 --frames 1 {} --out {}'.split(); main()\n"
    script = "import sys; from data_gen.__main__ import main\n"
    script += run.format("--set warmth=0.4", "night") + run.format("--without night", "day")
    run_process(sys.executable, "-c", script, cwd=tmp_path)
    night, day = (read_image(tmp_path / name / "00000_original.png") for name in ("night", "day"))
    red, _, blue = np.mean(night, axis=(0, 1)) / np.mean(day, axis=(0, 1))
    assert blue < 0.9 < red


def test_version_and_date_are_the_same_everywhere() -> None:
    """The wheel and the npm package take theirs from `link`, as `pyproject.toml` does."""
    cited = dict(re.findall(r"^(version|date-released): (\S+)$", CITATION, re.MULTILINE))
    released = re.search(r"^## (\S+) — (\S+)$", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert released is not None
    assert released.groups() == (__version__, cited["date-released"])
    assert cited["version"] == __version__
    assert f"version = {{{__version__}}}" in CITATION


@pytest.mark.exhaustive  # those of the README are run in CI
def test_the_commands_of_the_receiver_run(tmp_path: Path) -> None:
    shown = (ROOT / "docs" / "receiver.md").read_text()
    script = "".join(re.findall(r"^```bash\n(.*?)^```$", shown, re.DOTALL | re.MULTILINE))
    photo = np.random.default_rng(0).integers(60, 200, (384, 512, 3)).astype(np.uint8)
    write_image(tmp_path / "photo.png", photo)
    script = script.replace(".venv/bin/python", sys.executable)
    script = script.replace("runs/", f"{tmp_path}/").replace("photo.png", f"{tmp_path}/photo.png")
    done = run_process("bash", "-ec", script)
    assert '"text": "Hello"' in done.stdout
    assert (tmp_path / "player.html").is_file()
    assert list((tmp_path / "sent").glob("*.png"))
    assert list((tmp_path / "seen").glob("*.png"))
