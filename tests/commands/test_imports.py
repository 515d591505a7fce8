"""The import arrows that CONTRIBUTING.md lists, and what the folders share of style."""

import ast
import json
import re
import sys
from collections.abc import Callable, Iterator
from functools import cache
from graphlib import CycleError, TopologicalSorter
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT, Finished, run_process

from link.observation import Observation
from models import DECODERS, make_decoder

MAY_IMPORT = {
    "link": {"link"},
    "data_gen": {"data_gen", "link"},
    "models": {"models", "link"},
    "export": {"export", "models", "link"},
    "receiver": {"receiver", "export", "models", "link"},
    "sender": {"sender", "export", "models", "link"},
    "web": {"web", "receiver", "sender", "export", "models", "link"},
    "reports": {"reports", "receiver", "sender", "export", "models", "data_gen", "link"},
    "lab": {"lab", "web", "reports", "receiver", "sender", "export", "models", "data_gen", "link"},
    "examples": {"examples", "models", "data_gen", "link"},
    "train": {"reports", "receiver", "sender", "export", "models", "data_gen", "link"},
    "evaluate": {"reports", "receiver", "sender", "export", "models", "data_gen", "link"},
}
MINIMAL = {"numpy", "cv2", "onnxruntime", "filelock", "PIL"}
"""All that sender and receiver may need, beside the standard library."""
LEANS_ON_ANOTHER = re.compile(r"(Of|The same|As of|As in|See|Those|That of)\b")
LAB_ONLY = ["torch", "kornia", "sklearn", "onnx", "joblib", "tyro", "tqdm"]


def sources() -> list[Path]:
    """Every Python file of the application, relative to the root; tests are not part of it."""
    inside = [file for package in MAY_IMPORT for file in (ROOT / package).rglob("*.py")]
    return sorted(file.relative_to(ROOT) for file in [*ROOT.glob("*.py"), *inside])


@cache
def parsed(file: Path) -> ast.Module:
    return ast.parse((ROOT / file).read_text())


@cache
def import_statements(file: Path) -> list[ast.Import | ast.ImportFrom]:
    """Any of a file, wherever they stand."""
    return [
        node for node in ast.walk(parsed(file)) if isinstance(node, ast.Import | ast.ImportFrom)
    ]


def layer(file: Path) -> str:
    return file.parts[0].removesuffix(".py")


def imported(file: Path) -> Iterator[str]:
    """Names of the modules that any statement of a file imports."""
    for node in import_statements(file):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        else:
            assert node.level == 0, "imports are absolute"
            assert node.module is not None
            yield node.module


def packages_of(file: Path) -> set[str]:
    return {name.partition(".")[0] for name in imported(file)}


def tracked() -> list[str]:
    return run_process("git", "ls-files", "*.py").stdout.splitlines()


def test_every_tracked_file_belongs_to_a_layer() -> None:
    outside = {name for name in tracked() if not name.startswith("tests/")}
    assert outside <= {file.as_posix() for file in sources()}
    assert {layer(file) for file in sources()} == set(MAY_IMPORT)


def test_imports_point_one_way() -> None:
    against = {
        file.as_posix(): sorted(packages_of(file) & set(MAY_IMPORT) - MAY_IMPORT[layer(file)])
        for file in sources()
    }
    assert {file: names for file, names in against.items() if names} == {}


def module_name(file: Path) -> str:
    return ".".join(file.with_suffix("").parts).removesuffix(".__init__")


def test_no_module_imports_itself_by_way_of_others() -> None:
    """Imports inside functions and under TYPE_CHECKING count too."""
    modules = {module_name(file): file for file in sources()}
    graph: dict[str, set[str]] = {}
    for module, file in modules.items():
        graph[module] = set()
        for node in import_statements(file):
            if isinstance(node, ast.Import):
                graph[module] |= {alias.name for alias in node.names}
            else:
                inside = {f"{node.module}.{alias.name}" for alias in node.names}
                graph[module] |= inside & set(modules)
                if any(name not in modules for name in inside):
                    graph[module].add(str(node.module))
        graph[module] &= set(modules)
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail("a circle of imports: " + " -> ".join(error.args[1]))


def test_docstrings_can_be_understood_alone() -> None:
    """Those of constants and fields, which are strings below them, as well."""
    leaning = [
        f"{file}:{node.lineno}: {node.value.value}"
        for file in sources()
        for node in ast.walk(parsed(file))
        if isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and LEANS_ON_ANOTHER.match(str(node.value.value))
    ]
    assert not leaning, "\n".join(leaning)


def is_text(node: ast.stmt | None) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)


def undescribed(body: list[ast.stmt], wanted: Callable[[str], bool]) -> Iterator[str]:
    """Names that statements assign, if they are wanted and no string stands below them."""
    for node, below in pairwise([*body, None]):
        if isinstance(node, ast.Assign | ast.AnnAssign) and not is_text(below):
            target = node.targets[0] if isinstance(node, ast.Assign) else node.target
            names = [name.id for name in ast.walk(target) if isinstance(name, ast.Name)]
            yield from (name for name in names if name[0] != "_" and wanted(name))


def test_constants_and_fields_of_dataclasses_are_described() -> None:
    found = []
    for file in sources():
        names = list(undescribed(parsed(file).body, lambda name: name.isupper() and len(name) > 1))
        for node in parsed(file).body:
            decorated = isinstance(node, ast.ClassDef) and node.name[0] != "_"
            if decorated and "dataclass" in "".join(map(ast.unparse, node.decorator_list)):
                names += undescribed(node.body, bool)
        found += [f"{file}: {name}" for name in names]
    assert not found, "\n".join(found)


def test_nothing_cites_what_no_reader_can_open() -> None:
    words = ("[i]ssue [0-9]+", "--", ".", ":!CHANGELOG.md")
    assert run_process("git", "grep", "-nwE", *words, status=1).stdout == ""


@pytest.mark.parametrize(
    "file", [f for f in sources() if layer(f) == "link" or f.name == "runtime.py"], ids=str
)
def test_the_contract_and_the_runtime_import_next_to_nothing(file: Path) -> None:
    foreign = packages_of(file) - set(sys.stdlib_module_names) - set(MAY_IMPORT)
    assert foreign <= MINIMAL


BLOCK = """
import sys
class Blocked:
    names = set({names!r})
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in self.names:
            raise ModuleNotFoundError(f"{{name}} is blocked", name=name)
sys.meta_path.insert(0, Blocked())
"""
LEFT_OUT = """
assert not Blocked.names & {name.partition(".")[0] for name in sys.modules}
"""


def run_without(names: list[str], script: str, *args: Path | str, status: int = 0) -> Finished:
    """Run a script in a Python that cannot import the named packages."""
    code = BLOCK.format(names=names) + script + LEFT_OUT
    return run_process(sys.executable, "-c", code, *args, status=status)


@pytest.fixture(scope="module")
def frames(rectified: Observation, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """The original and the embedded frame as .npy files."""
    folder = tmp_path_factory.mktemp("frames")
    paths = [folder / "original.npy", folder / "embedded.npy"]
    for path, frame in zip(paths, (rectified.original, rectified.embedded), strict=True):
        np.save(path, frame)
    return paths


@pytest.mark.parametrize("name", LAB_ONLY)
def test_the_block_blocks(name: str) -> None:
    assert f"{name} is blocked" in run_without([name], f"import {name}", status=1).stderr


DECODE_WITH_METHODS = """
import json
import numpy as np
from link.observation import Observation
from link.layout import make_layout
from models import make_decoder
pair = Observation.still(np.load(sys.argv[1]), np.load(sys.argv[2]), make_layout(), 5)
print(json.dumps({name: make_decoder(name).decode(pair).bits.tolist() for name in sys.argv[3:]}))
"""


def is_torch_free(target: str) -> bool:
    return target.startswith(("models.paper.", "models.blind."))


@pytest.mark.slow
def test_methods_of_the_paper_decode_without_torch(
    rectified: Observation, frames: list[Path]
) -> None:
    names = [name for name, card in DECODERS.items() if is_torch_free(card.target)]
    result = run_without(["torch", "kornia"], DECODE_WITH_METHODS, *frames, *names)
    expected = {name: make_decoder(name).decode(rectified).bits.tolist() for name in names}
    assert json.loads(result.stdout) == expected
    assert len(names) == 5


@pytest.mark.slow
def test_every_module_that_should_imports_without_torch() -> None:
    wanted = [f for f in sources() if layer(f) == "link" or f.parts[:2] == ("models", "paper")]
    names = [
        "models",
        "export",
        "receiver",
        "sender",
        *(".".join(f.with_suffix("").parts) for f in wanted),
        "evaluate",  # its workers load torch, and the main process would for nothing
    ]
    modules = [name.removesuffix(".__init__") for name in names]
    run_without(["torch", "kornia"], "\n".join(f"import {name}" for name in modules))
    assert len(modules) > 15


def test_sender_and_receiver_need_the_deploy_group_alone() -> None:
    commands = ("receiver", "receiver.locate", "receiver.bench", "sender")
    pages = ("web.__main__", "web.host.site")
    run_without(LAB_ONLY, "\n".join(f"import {name}" for name in (*commands, *pages)))


SEND_WITHOUT_FLOCK = """
import os
from importlib import import_module
from pathlib import Path
from link.files.lock import locked
for name in ("receiver.__main__", "receiver.locate.__main__", "receiver.bench"):
    import_module(name)
folder = Path(sys.argv[1])
with locked(folder), locked(folder, "x.html"):
    assert sorted(os.listdir(folder)) == [".lock", ".x.html.lock"]
sys.argv = ["send", sys.argv[2], "--message", "a", "--out", str(folder / "x.html")]
import_module("sender.__main__").main()
"""


@pytest.mark.slow
def test_sender_and_receiver_lock_where_the_system_has_no_flock(tmp_path: Path) -> None:
    run_without(["fcntl"], SEND_WITHOUT_FLOCK, tmp_path, ROOT / "docs" / "ablation.png")
    assert [file.name for file in tmp_path.iterdir()] == ["x.html"]
