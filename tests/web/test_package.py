"""The receiver outside of the checkout: a wheel, an npm package, and the events of both."""

import ast
import copy
import functools
import json
import os
import re
import sys
import zipfile
from collections.abc import Mapping
from pathlib import Path
from time import sleep
from typing import Any

import cv2
import numpy as np
import pytest
from conftest import ROOT, Command, cases, run_process, slow
from jsonschema import Draft202012Validator
from pilot_films import CORNERS, filmed, texture
from streams import write_film

import web.package.__main__ as package_cli
from link.code.authenticate import sign
from link.code.framing import encode
from link.errors import InputError
from link.geometry import homography_from_corners
from link.images import write_image
from link.presets import PRESETS
from link.types import Image
from web.host.site import WEB
from web.package.api import (
    FilmEvent,
    LiveReceiver,
    Receiver,
    hidden_states,
    luma,
    read_pair,
)
from web.package.schema import events_schema, typescript_of
from web.package.wheel import OWN, package_files, write_wheel

ROBUST = PRESETS["robust"].layout
TEXT = "no marks"
KEY = bytes(range(32))
EMBED = (ROOT / "docs" / "embed.md").read_text("utf-8")
SHOWN = re.findall(r"^```(python|js)\n(.*?)^```$", EMBED, re.DOTALL | re.MULTILINE)
DEFINED = events_schema()["$defs"]


def check_event(event: Mapping[str, Any]) -> None:
    """Hold an event against the schema, and refuse keys that the schema does not have."""
    schema = copy.deepcopy(events_schema())
    for kind in schema["$defs"].values():
        kind["additionalProperties"] = False
    Draft202012Validator(schema).validate(json.loads(json.dumps(event)))


@functools.cache
def film(data: bytes = TEXT.encode(), signed: bool = False) -> list[Image]:
    """Gray frames of the preset robust, whose states are shown for two frames each."""
    return filmed(ROBUST, 28, seed=3, message=encode(data, ROBUST.n_bits, signed=signed))[0]


def test_the_schema_in_the_repository_is_that_of_the_events() -> None:
    written = json.loads((ROOT / "web" / "package" / "events.schema.json").read_text("utf-8"))
    assert written == events_schema(), "take it from python -m web.package --only wheel --out"
    Draft202012Validator.check_schema(written)


@pytest.mark.parametrize("kind", DEFINED.values(), ids=list(DEFINED))
def test_the_docs_name_all_keys_of_an_event(kind: dict[str, Any]) -> None:
    name, *keys = kind["properties"]
    formats = (ROOT / "docs" / "formats.md").read_text("utf-8").partition("| event |")[2]
    row = re.findall(rf"^\| `{kind['properties'][name]['const']}` \|.*", formats, re.MULTILINE)
    assert len(row) == 1
    assert not [key for key in keys if f"`{key}`" not in row[0]]
    for key in keys:
        assert typescript_of(kind["properties"][key])


@pytest.mark.slow
def test_the_wheel_has_one_import_name_and_takes_nothing_from_the_checkout() -> None:
    files = package_files()
    assert {path.partition("/")[0] for path in files} == {"oorc_receiver"}
    modules = {path.removesuffix(".py").replace("/", ".") for path in files}
    taken = set()
    for path, data in files.items():
        for node in ast.walk(ast.parse(data)) if path.endswith(".py") else ():
            if isinstance(node, ast.Import):
                taken |= {alias.name.partition(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module:
                taken.add(node.module.partition(".")[0])
                if node.module.startswith("oorc_receiver"):
                    assert {node.module, f"{node.module}.__init__"} & modules, node.module
    foreign = taken - set(sys.stdlib_module_names)
    assert foreign - {"oorc_receiver", "numpy", "cv2", "onnxruntime"} == {"PIL"}  # for a command
    assert sum(path.endswith(".onnx") for path in files) == len(PRESETS) + 2  # films, regions


@pytest.mark.slow
def test_the_command_writes_a_wheel_that_is_the_same_each_time(
    tmp_path: Path, command: Command
) -> None:
    done = command(package_cli.main, "--out", tmp_path, "--only", "wheel")
    sizes = json.loads(done.stdout)["files"]
    assert {name: (tmp_path / name).stat().st_size for name in sizes} == sizes
    assert json.loads((tmp_path / "events.schema.json").read_bytes()) == events_schema()
    (wheel,) = tmp_path.glob("*.whl")
    assert wheel.read_bytes() == write_wheel(tmp_path / "again").read_bytes()
    with zipfile.ZipFile(wheel) as archive:
        (metadata,) = [name for name in archive.namelist() if name.endswith("METADATA")]
        lines = archive.read(metadata).decode().splitlines()
    needs = [re.split("[ >]", line)[1] for line in lines if line.startswith("Requires-Dist")]
    assert sorted(needs) == ["numpy", "onnxruntime", "opencv-python-headless"]
    extra = [line for line in lines if line.endswith("extra == 'opencv'")]
    assert [re.split("[ >]", line)[1] for line in extra] == ["opencv-python-headless"]


GRAY = np.full((40, 40), 90, np.uint8)


def pushed(*times: Any, frame: Any = GRAY) -> None:
    """Push a frame at some times."""
    receiver = Receiver(30)
    for time in times:
        receiver.push(frame, time)


def finished() -> None:
    receiver = Receiver(30)
    receiver.finish()
    receiver.push(GRAY, 0)


@cases(
    *[(lambda fps=fps: Receiver(fps), "argument", "fps") for fps in (0, np.nan, "30")],
    *[(lambda key=key: Receiver(30, key=key), "argument", "bytes") for key in ("k" * 20, b"k")],
    *[
        (lambda age=age: Receiver(30, key=KEY, max_age_s=age), "argument", "max_age")
        for age in (np.nan, 0, "5")
    ],
    (lambda: Receiver(30, max_age_s=3), "argument", "give a key"),
    (lambda: Receiver(30, threads=1.5), "argument", "threads"),
    (lambda: Receiver(30, scores="no"), "argument", "need True or False"),
    (lambda: Receiver(30, threads=0), "argument", "threads"),
    (lambda: Receiver(30, models="paper"), "argument", "a list of presets"),
    (lambda: Receiver(30, models=["nothing"]), "model", "nothing: no such model; name one of pap"),
    (lambda: Receiver(30, models=["paper", "paper"]), "argument", "one of each"),
    (lambda: LiveReceiver(None, print), "argument", "give a Receiver"),
    (lambda: Receiver(30, models=[__file__]), "model", "not a readable ONNX model"),
    *[
        (lambda frame=frame: pushed(0, frame=frame), "frame", "frames must be")
        for frame in (GRAY[:4, :4], GRAY / 255.0, None, "x.png", [[1, 2], [3]])
    ],
    *[
        (lambda time=time: pushed(time), "time", "finite number")
        for time in (np.nan, None, "0", 10**400, np.timedelta64(1, "s"))
    ],
    (lambda: pushed(1, 0.5), "time", "must rise"),
    (lambda: pushed(0, 33.3, 66.7, 100), "time", "33.3 s apart.*not milliseconds"),
    (finished, "finished", "make a new one"),
    (lambda: luma(np.zeros((40, 40), np.uint8)), "frame", "planes"),
    (lambda: read_pair(GRAY, GRAY, corners=np.eye(4, 2)), "argument", "name the"),
    *[
        (lambda at=at: read_pair(GRAY, GRAY, corners=at, model="robust"), "argument", "corners")
        for at in ("abc", np.full((4, 2), np.nan), np.eye(4, 2), 1e300 * np.eye(4, 2))
    ],
    (lambda: read_pair(GRAY, GRAY[:20], model="robust"), "frame", "size"),
    (lambda: hidden_states(GRAY, "text"), "argument", "give bytes"),
    (lambda: hidden_states(GRAY, b""), "argument", "empty"),
    (lambda: hidden_states(GRAY, b"hi", preset="none"), "argument", "unknown preset"),
    (lambda: hidden_states(GRAY, b"hi", preset=["paper"]), "argument", "unknown preset"),
    (lambda: hidden_states(GRAY, bytes(2**21)), "argument", "bytes"),
    (lambda: hidden_states(np.dstack([GRAY] * 4), b"hi"), "frame", "frames must be"),
    (lambda: hidden_states(np.tile(GRAY, 4), b"hi"), "frame", "longer than 3:1; crop it"),
    slow(
        lambda: read_pair(*np.full((2, 480, 640), 90, np.uint8), model="robust"),
        "no-display",
        "no display",
    ),
)
def test_wrong_arguments_are_refused_in_one_line(call: Any, code: str, says: str) -> None:
    with pytest.raises(InputError, match=says) as error:
        call()
    assert "\n" not in str(error.value)
    assert error.value.code == code
    assert f"`{code}`" in EMBED


@pytest.mark.slow
def test_states_of_the_package_are_read_beside_a_camera_that_never_waits() -> None:
    events: list[FilmEvent] = []
    reader = LiveReceiver(Receiver(30, models=["robust"]), events.append)
    picture = np.clip(150 + 20 * texture((384, 512), 3), 0, 255).astype(np.uint8)
    states = list(hidden_states(picture, TEXT.encode(), preset="robust"))
    H, rng = homography_from_corners(CORNERS, 512, 384), np.random.default_rng(0)
    for number in range(40):
        gray = cv2.cvtColor(states[number // 2 % len(states)], cv2.COLOR_RGB2GRAY).astype(float)
        frame = cv2.warpPerspective(gray, H, (640, 480), borderValue=60.0)
        planes = np.vstack([frame + rng.normal(0.5, 1, frame.shape), np.full((240, 640), 128)])
        reader.push(luma(planes.clip(0, 255).astype(np.uint8)), number / 30)
        while reader.waits:  # a camera would not; so each frame is read
            sleep(0.001)
    reader.finish()
    assert [event["text"] for event in events if event["event"] == "message"][:1] == [TEXT]
    assert reader.passed_over == 0
    assert reader.explanation.startswith(f"a message of {len(TEXT)} bytes came")
    with pytest.raises(InputError, match="finished"):
        reader.finish()
    with pytest.raises(InputError, match="finished"):
        reader.push(states[0], 2)


@pytest.mark.slow
def test_events_of_films_fit_the_schema() -> None:
    receiver = Receiver(30, models=["robust"], key=KEY, scores=True)
    events = []
    for number, image in enumerate(film(sign(b"hi", KEY, 7), signed=True)):
        events += receiver.push(image, number / 30)
    events += receiver.finish()
    for event in events:
        check_event(event)
    taken = next(event for event in events if event["event"] == "message")
    assert taken["stamp"] == 7
    assert events[-1]["event"] == "end"


# Fresh environments, in which docs/embed.md is tried


@pytest.fixture
def elsewhere(tmp_path: Path) -> Path:
    """A folder outside of the checkout with the film of docs/embed.md."""
    frames = film()
    write_film(tmp_path / "film.avi", frames, codec="FFV1")
    (tmp_path / "film.gray").write_bytes(b"".join(frame.tobytes() for frame in frames))
    for name, frame in (("first", frames[0]), ("second", frames[2])):
        write_image(tmp_path / f"{name}.png", np.dstack([frame] * 3))
    return tmp_path


RUN_ELSEWHERE = f"""
import sys
sys.path.insert(0, "site")
for name in sys.argv[1:]:
    exec(open(name).read(), {{}})
loaded = {{name.partition(".")[0] for name in sys.modules}}
assert "oorc_receiver" in loaded and not loaded & {{"torch", *{OWN}}}, loaded
"""


def run_in(folder: Path, *words: str) -> str:
    """Run a program in a folder, and return what it prints."""
    without = {name: None for name in os.environ if name.startswith("PYTHON")}
    return run_process(*words, cwd=folder, **without).stdout


@pytest.mark.slow
def test_python_of_the_docs_runs_without_the_checkout(elsewhere: Path) -> None:
    wheel = write_wheel(elsewhere)
    pip = (sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--no-index")
    run_in(elsewhere, *pip, "--target", "site", str(wheel))
    installed = [path.name for path in (elsewhere / "site").iterdir()]
    assert sorted(name.partition("-")[0] for name in installed) == ["oorc_receiver"] * 2
    shown = [code for language, code in SHOWN if language == "python"]
    names = [f"shown{number}.py" for number in range(len(shown))]
    for name, code in zip(names, shown, strict=True):
        (elsewhere / name).write_text(code)
    said = run_in(elsewhere, sys.executable, "-I", "-c", RUN_ELSEWHERE, *names)
    first, explanation, pair = said.splitlines()
    assert first == TEXT
    assert explanation
    assert len(pair.split()[0]) == ROBUST.n_bits


EVENTS = """
import { readFileSync } from "node:fs";
import { type FilmEvent, load, Receiver, type State } from "oorc-receiver";

const SIZE: number = 640 * 480;
await load();
const film = readFileSync("film.gray");
const receiver = new Receiver(30, { models: ["robust"], scores: true });
const events: FilmEvent[] = [];
for (let at = 0; at < film.length / SIZE; at++) {
  const data = film.subarray(at * SIZE, (at + 1) * SIZE);
  events.push(...(await receiver.push({ width: 640, height: 480, data }, at / 30)));
}
for (const event of [...events, ...(await receiver.finish())]) console.log(JSON.stringify(event));
export const draw = ({ data, width }: State) => new ImageData(data, width);
"""


@pytest.mark.slow
def test_javascript_of_the_docs_runs_without_the_checkout(
    elsewhere: Path, npm_package: Path
) -> None:
    (elsewhere / "node_modules").symlink_to(npm_package)
    picture = np.random.default_rng(0).integers(0, 256, (300, 400, 3), dtype=np.uint8)
    (elsewhere / "picture.rgb").write_bytes(picture.tobytes())
    reading, sending = (code for language, code in SHOWN if language == "js")
    (elsewhere / "shown.mjs").write_text(reading)
    (elsewhere / "sent.mjs").write_text(sending)
    (elsewhere / "events.mts").write_text(EVENTS)
    compiler = WEB / "node_modules" / "typescript" / "bin" / "tsc"
    strict = ("--strict", "--module", "nodenext", "--target", "es2022", "--types", "node")
    run_in(elsewhere, "node", str(compiler), *strict, "--skipDefaultLibCheck", "events.mts")
    # which loads the package once
    all_three = " ".join(f'await import("./{name}.mjs");' for name in ("shown", "events", "sent"))
    shown, *lines = run_in(elsewhere, "node", "--input-type=module", "-e", all_three).splitlines()
    assert shown == TEXT
    sent = (elsewhere / "states-512x384.rgba").read_bytes()
    states = np.frombuffer(sent, np.uint8).reshape(-1, 384, 512, 4)
    assert (states[:, :, :, :3] == list(hidden_states(picture, b"Hi", preset="robust"))).all()
    found = [json.loads(line) for line in lines]
    for event in found:
        check_event(event)
    receiver, known = Receiver(30, models=["robust"], scores=True), []
    for number, image in enumerate(film()):
        known += receiver.push(image, number / 30)
    known += receiver.finish()
    keys = {event["event"]: sorted(event) for event in known}
    assert {event["event"]: sorted(event) for event in found} == keys
    said = [event["text"] for event in found if event["event"] == "message"]
    assert said == [event["text"] for event in known if event["event"] == "message"]
