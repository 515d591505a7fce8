"""The npm package: what it refuses, and applications that bundlers make of it."""

import json
import re
import shutil
import subprocess
import tarfile
import time
from hashlib import sha256
from itertools import cycle, islice, product
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import PIL.Image
import pytest
import skimage.data
from browser import serve_folder, wait_for
from conftest import OpenWindow, cases, exhaustive, run_process
from pilot_films import TEXT, robust_film

from link.images.files import read_image
from link.presets import PRESETS
from link.types import Image
from web.host.site import WEB
from web.package.api import hidden_states
from web.package.npm import write_npm_package

NEEDED = ("@noble", "@types", "onnxruntime-web", "onnxruntime-common")
"""Packages that npm would install beside it."""
ORT = WEB / "node_modules" / "onnxruntime-web" / "dist"
"""Where onnxruntime's files lie, which an application serves."""


def install_package(folder: Path) -> None:
    """Install the package in the folder of an application."""
    with tarfile.open(write_npm_package(folder)) as archive:
        archive.extractall(folder, filter="data")
    modules = folder / "node_modules"
    modules.mkdir()
    (folder / "package").rename(modules / "oorc-receiver")
    for name in NEEDED:
        (modules / name).symlink_to(WEB / "node_modules" / name)


REFUSED = """
import { hiddenStates, load, InputError, Receiver } from "oorc-receiver";
import { LiveReceiver } from "oorc-receiver/live.js";
const [W, H] = [64, 48];
const data = Uint8Array.from({ length: W * H }, (_, i) => (i * 7919) % 251);
const good = { width: W, height: H, data };
const of = (...given) => new Receiver(...given);
const push = (frame, time = 0) => of(30).push(frame, time);
const pushes = async (...times) => {
  const receiver = of(30);
  for (const time of times) await receiver.push(good, time);
};
const told = [];
const tell = async (task) => {
  try {
    await task();
    told.push("none");
  } catch (error) {
    const isOne = error instanceof InputError && !error.message.includes("\\n");
    told.push(isOne ? error.code : `${error}`);
  }
};
const text = new Uint8Array(9);
await tell(() => of(30));
await tell(() => hiddenStates(good, text));
await tell(() => load("file:///nothing/"));
await load();
const frames = [
  null, undefined, {}, { ...good, data: data.subarray(9) }, { ...good, width: 64.5 },
  { ...good, data: new Float32Array(W * H) }, { ...good, data: Array(W * H).fill(3) },
  { ...good, width: "64" }, { ...good, width: NaN }, { ...good, width: -W, height: -H },
  { width: 4, height: 4, data: new Uint8Array(16) }, { ...good, data: new Uint8Array(3 * W * H) },
];
for (const frame of frames) await tell(() => push(frame));
told.push("|");
for (const time of [NaN, Infinity, "1", 1n, null, {}]) await tell(() => push(good, time));
await tell(() => pushes(1, 1));
await tell(() => pushes(0, 33, 67, 100));
told.push("|");
const key = new Uint8Array(16);
const settings = [
  null, { models: "robust" }, { models: [] }, { models: ["paper"] }, { key: "x".repeat(20) },
  { key: key.subarray(9) }, { maxAgeS: 4 }, { key, maxAgeS: NaN }, { frameMs: -1 },
  { model: ["hidden"] }, { models: ["fast", "fast"] }, { models: [Symbol()] }, { scores: "no" },
];
for (const fps of [0, NaN, "30", undefined, Infinity]) await tell(() => of(fps));
for (const options of settings) await tell(() => of(30, options));
told.push("|");
for (const task of ["finish", "push"]) {
  const receiver = of(30);
  await receiver.finish();
  await tell(() => receiver[task](good, 1));
}
const taken = [1, 1.5, 4].map((size) => new Uint8ClampedArray(size * W * H));
for (const data of taken) await tell(() => push({ ...good, data }));
told.push("|");
for (const picture of [...frames, { width: 16, height: 90, data: new Uint8Array(16 * 90) }]) {
  if (picture?.data?.length !== 3 * W * H) await tell(() => hiddenStates(picture, text));
}
told.push("|");
const state = (picture, message, options) => tell(() => hiddenStates(picture, message, options));
const messages = [null, "text", [1], new Uint16Array(4), new Uint8Array(), new Uint8Array(2 ** 21)];
for (const message of messages) await state(good, message);
for (const preset of ["none", null, 1, NaN, {}, Symbol()]) await state(good, text, { preset });
for (const options of [null, "fast", { presets: "fast" }]) await state(good, text, options);
for (const size of [1, 3, 4]) await state({ ...good, data: new Uint8Array(size * W * H) }, text);
told.push("|");
const worker = { postMessage: (data) => self.onmessage({ data }), terminate: () => {} };
globalThis.self = { postMessage: (data) => setTimeout(() => worker.onmessage({ data })) };
await import("./node_modules/oorc-receiver/worker.js");
const events = [];
const wrong = [null, { folder: 5 }, { worker: "worker.js" }];
await tell(() => new LiveReceiver(30, null));
for (const options of wrong) await tell(() => new LiveReceiver(30, () => 0, options));
const live = new LiveReceiver(30, (event) => events.push(event.event), { worker });
live.push(good, 0);
const early = live.explanation(); // is asked for while the frame is read
await live.finish();
told.push((await early).length > 9, (await live.explanation()).length > 9, ...events);
await tell(() => live.push(good, 1));
await tell(() => live.finish());
console.log(JSON.stringify(told));
"""


@pytest.mark.slow
def test_all_that_is_wrong_is_refused_at_the_door_with_a_code(
    npm_package: Path, tmp_path: Path
) -> None:
    (tmp_path / "node_modules").symlink_to(npm_package)
    (tmp_path / "refused.mjs").write_text(REFUSED)
    told = json.loads(run_process("node", "refused.mjs", cwd=tmp_path).stdout)
    assert told == [
        *["load"] * 3,
        *["frame"] * 12,
        "|",
        *["time"] * 8,
        "|",
        *["argument"] * 18,
        "|",
        *["finished"] * 2,
        *["none"] * 3,
        "|",
        *["frame"] * 12,
        "|",
        *["argument"] * 15,
        *["none"] * 3,
        "|",
        *["argument"] * 4,
        *[True, True, "end"],
        *["finished"] * 2,
    ]


STATES = """
import { createHash } from "node:crypto";
import { readFileSync } from "node:fs";
import { hiddenStates, load } from "oorc-receiver";
await load();
const told = [];
for (const asked of JSON.parse(readFileSync("asked.json", "utf8"))) {
  const { name, preset, message, most, width, height } = asked;
  const picture = { width, height, data: readFileSync(name) };
  let count = 0;
  for (const state of hiddenStates(picture, new TextEncoder().encode(message), { preset })) {
    const hash = createHash("sha256").update(state.data).digest("hex");
    told.push([name, preset, state.width, state.height, hash]);
    if (++count === most) break;
  }
}
console.log(JSON.stringify(told));
"""


def pictures_of_many_kinds() -> dict[str, Image]:
    """Photographs, large, small, dark, upright, gray and of odd sides; flat ones; clear ones."""
    coffee = skimage.data.coffee()
    resized = {"large": (2500, 1700), "small": (100, 75), "odd": (643, 485), "upright": (480, 641)}
    clear = skimage.data.logo()
    clear[:, :, 3] = np.linspace(0, 255, len(clear)).astype(np.uint8)
    return {
        "photograph": coffee,
        "dark": coffee // 12,
        "gray": skimage.data.camera(),
        "flat": np.full((768, 1024, 3), 128, np.uint8),
        "black": np.zeros((1080, 1920, 3), np.uint8),
        "white": np.full((1080, 1920, 3), 255, np.uint8),
        "logo": skimage.data.logo(),
        "clear": clear,
        **{name: cv2.resize(coffee, size) for name, size in resized.items()},
    }


@pytest.mark.slow
@cases("in turn", exhaustive("all"))
def test_states_are_those_of_python_in_every_pixel(
    presets: str, npm_package: Path, tmp_path: Path
) -> None:
    """The first states of each picture in a preset, in turn, or in all; and all of the photograph.

    Its message in the preset hidden is longer than the code, where its loop breaks off.
    """
    pictures, greeting = pictures_of_many_kinds(), "Gr\u00fc\u00dfe"
    turns = zip(pictures, cycle(PRESETS), strict=False)
    pairs = product(pictures, PRESETS) if presets == "all" else turns
    shown = [(name, preset, greeting, 4) for name, preset in pairs]
    messages = {"paper": greeting, "hidden": "\0" * 3200, "robust": greeting}
    shown += [("photograph", preset, message, 1000) for preset, message in messages.items()]
    asked = [
        {"name": name, "preset": preset, "message": message, "most": most}
        | dict(zip(("height", "width"), pictures[name].shape, strict=False))
        for name, preset, message, most in shown
    ]
    (tmp_path / "node_modules").symlink_to(npm_package)
    (tmp_path / "states.mjs").write_text(STATES)
    (tmp_path / "asked.json").write_text(json.dumps(asked))
    for name, picture in pictures.items():
        (tmp_path / name).write_bytes(picture.tobytes())
        if picture.shape[2:] == (4,):
            PIL.Image.fromarray(picture).save(tmp_path / f"{name}.png")
            pictures[name] = read_image(tmp_path / f"{name}.png")
    told = json.loads(run_process("node", "states.mjs", cwd=tmp_path).stdout)
    made = []
    for name, preset, message, most in shown:
        states = hidden_states(pictures[name], message.encode(), preset=preset)
        for state in islice(states, most):
            height, width = state.shape[:2]
            opaque = np.dstack([state, np.full((height, width), 255, np.uint8)])
            made.append([name, preset, width, height, sha256(opaque.tobytes()).hexdigest()])
    assert told == made


APP = """
import { hiddenStates, load } from "oorc-receiver";
import { LiveReceiver } from "oorc-receiver/live.js";
const film = new Uint8Array(await (await fetch("film.gray")).arrayBuffer());
const worker = WORKER;
const live = new LiveReceiver(30, (event) => {
  if (event.event === "message") document.title = event.text;
}, { folder: "receiver/", models: ["robust"], ...(worker ? { worker } : {}) });
const [width, height] = [640, 480];
for (let at = 0; at < film.length / (width * height); at++) {
  const data = film.slice(at * width * height, (at + 1) * width * height);
  const before = performance.now();
  live.push({ width, height, data }, at / 30);
  window.slowest = Math.max(window.slowest ?? 0, performance.now() - before);
  while (live.isBusy) await new Promise((resolve) => setTimeout(resolve, 20));
}
await live.finish();
await load("receiver/");
const picture = { width, height, data: film.subarray(0, width * height) };
const shown = document.createElement("canvas").getContext("2d");
[shown.canvas.width, shown.canvas.height] = [width, height];
for (const { data } of hiddenStates(picture, new Uint8Array(9), { preset: "robust" })) {
  shown.putImageData(new ImageData(data, width), 0, 0);
}
window.levels = shown.getImageData(0, 0, width, height).data.reduce((sum, level) => sum + level);
document.title ||= await live.explanation();
"""
VITE = """
export default {
  optimizeDeps: { exclude: ["oorc-receiver"] },
  worker: { format: "es" },
  build: { target: "es2022" },
  server: { fs: { strict: false } }, // as packages of this test are links
};
"""
"""What docs/embed.md tells users of vite, but for the last line."""
ESBUILD = ("--bundle", "--format=esm", "--splitting", "--outdir=esbuilt", "--external:fs",
           "--external:path", "--external:crypto")  # fmt: skip


@pytest.mark.exhaustive
def test_applications_of_vite_and_esbuild_read_a_film(
    npm_package: Path, tmp_path: Path, open_window: OpenWindow
) -> None:
    """Install vite from npm into a folder of its own, and bundle docs/embed.md's application.

    It takes half a minute and npm's registry; `.github/workflows/tests.yml` runs it.
    """
    found = run_process("npm", "view", "vite", "version", status=None)
    if found.status:
        pytest.skip("npm's registry cannot be reached")
    (tmp_path / "package.json").write_text('{"type": "module"}')
    npm = ("npm", "install", "--no-audit", "--no-fund", "--silent", "vite@7")
    run_process(*npm, cwd=tmp_path)
    for name in ("oorc-receiver", *NEEDED):
        if not (tmp_path / "node_modules" / name).exists():
            (tmp_path / "node_modules" / name).symlink_to(npm_package / name)
    public = tmp_path / "public"
    shutil.copytree(npm_package / "oorc-receiver", public / "receiver")
    for kind in ("wasm", "mjs"):
        shutil.copy(ORT / f"ort-wasm-simd-threaded.{kind}", public / "receiver")
    (public / "film.gray").write_bytes(b"".join(each.tobytes() for each in robust_film(36)[0]))
    (tmp_path / "index.html").write_text(
        '<title></title><script type="module" src="main.js"></script>'
    )
    (tmp_path / "vite.config.js").write_text(VITE)
    (tmp_path / "main.js").write_text(APP.replace("WORKER", "null"))
    run_process("npx", "vite", "build", cwd=tmp_path)
    with serve_folder(tmp_path / "dist") as url:
        check_reads(url, open_window(300, 200))
    vite = [tmp_path / "node_modules" / ".bin" / "vite"]
    with subprocess.Popen(vite, cwd=tmp_path, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        lines = iter(server.stdout.readline, "")
        url = next(
            found[0]
            for line in lines
            if (found := re.search(r"http://localhost:\d+/", re.sub(r"\x1b\[\d+m", "", line)))
        )
        check_reads(url, open_window(300, 200))
        server.terminate()
    own = 'new Worker("worker.js", { type: "module" })'
    (tmp_path / "main.js").write_text(APP.replace("WORKER", own))
    worker = "node_modules/oorc-receiver/worker.js"
    esbuild = str(WEB / "node_modules" / ".bin" / "esbuild")
    run_process(esbuild, "main.js", f"worker={worker}", *ESBUILD, cwd=tmp_path)
    shutil.copytree(tmp_path / "esbuilt", public, dirs_exist_ok=True)
    shutil.copy(tmp_path / "index.html", public)
    with serve_folder(public) as url:
        check_reads(url, open_window(300, 200))


def check_reads(url: str, page: Any) -> None:
    """Open an application that reads a film, never waits to push a frame, and draws states."""
    page.on("pageerror", lambda error: print(error))
    page.on("console", lambda message: print(message.text))
    page.goto(url)
    deadline = time.monotonic() + 60
    while not page.title():
        assert time.monotonic() < deadline
        page.wait_for_timeout(100)
    assert page.title() == TEXT.decode()
    assert page.evaluate("slowest") < 100
    *_, last = hidden_states(robust_film(36)[0][0], bytes(9), preset="robust")
    wait_for(page, lambda: page.evaluate("window.levels") == last.sum() + 255 * last[:, :, 0].size)
