"""Commands on mutated inputs: manifests, stored runs, models, images, videos, layouts, and more.

`Inputs` makes sound inputs once, and from them any number of cases: a command and its words. What a
case must not do is in commands/test_fuzz.py.
"""

import json
import random
import shutil
import string
from dataclasses import asdict
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import onnx
from runs import write_run
from streams import Stream, states_of, write_film

from data_gen.pairs import get_pair
from link.captures import MANIFEST, save_captures
from link.embed import embed
from link.frames import Captured
from link.geometry import frame_corners
from link.images import write_image
from link.layout import make_layout
from models import PRETRAINED
from reports.evaluation.page import write_report

LAYOUT = make_layout()
MODEL = PRETRAINED / "decoder.onnx"
TEXT = "right"
"""The message of all sound films."""
RECEIVE = "receiver.__main__"
NASTY: list[Any] = [
    None, True, False, 0, -1, 1.5, 2**31, 2**63, 10**23, 10**400, 1e308, float("nan"), float("inf"),
    "", "x", "\ud800", "\0", "²", "../../../../etc/passwd", "/etc/passwd", "n" * 300, "\u2028", [],
    {}, [[]], [1, [2]], {"a": {"b": []}}, "9" * 5000, ["x"] * 50, list(range(70)), "<script>",
]  # fmt: skip
WORDS = [
    "nan", "inf", "-inf", "1e400", "-1", "0", "1.5", "9" * 23, "-" + "9" * 31, "²", "", " ", "x",
    "n" * 300, "\udcff", "[[[[", "{}", "/dev/null", "/dev/zero", "/dev/full/x", "../x", "\u2028",
    "drift=NaN", "drift=" + "[" * 2000, "a=" + "9" * 5000, "=", "--", "-", "1,2", "\n",
]  # fmt: skip


SOUND = (
    "evaluate --pairs canon-lg --views 45 --kappas 3 --frames 1 --methods naive --seed 0 --jobs 1 "
    "--no-html --ratex 5 --set drift=0.1 --without noise --out {out}",
    "data_gen.__main__ --frames 1 --pair canon-lg --view 0 --kappa 3 --seed 0 --rows 8 --cols 8 "
    "--width 512 --height 384 --ratex 5 --set drift=0.1 --out {out}",
    "data_gen.video --message hi --seconds 0.1 --size 160 120 --fps 30 --state-hz 15 --hand 1 "
    "--start-s 0 --first 0 --coverage 0.4 --drop 0 --turn 0 --seed 0 --jumps-hz 0 "
    "--free 0 --out {out}",
    "sender.__main__ {good}/a.png --message hi --kappa 3 --hold 4 --refresh 60 --rows 8 "
    "--cols 8 --width 512 --height 384 --ratex 5 --out {out}",
    "receiver.__main__ {good}/a.png {good}/b.png --threads 2 --scores",
    "receiver.__main__ {good}/film.avi --threads 2 --fps 30 --show {out}",
    "receiver.locate.__main__ {good}/a.png --show {out} --max-megapixels 5",
    "export.runtime {model} {good}/a.png {good}/b.png --corners 60,40 570,40 570,420 60,420",
    "sender.__main__ {good}/a.png --message hi --modulation antipodal --pilots auto --ratex 0 "
    "--rows 8 --cols 8 --key {good}/key --counter 7 --out {out}",
    "receiver.__main__ {good}/film.avi --key {good}/key --max-age 60 --threads 2",
    "data_gen.__main__ --frames 1 --rows 12 --cols 12 --modulation antipodal --pilots 0.1 "
    "--out {out}",
    "train --pair canon-lg --seed 0 --batch 0 --lr 0.1 --kappas 3 --jobs 1 --out {out}",
)
"""Command lines that are mutated; that of train.py is refused as it is, because it takes long."""


LISTS = (
    "ffconcat version 1.0\n" + "file film.avi\n" * 50,
    "ffconcat version 1.0\nfile {good}/film.avi\n",
    "#EXTM3U\n#EXT-X-TARGETDURATION:9\n#EXTINF:9,\n{good}/film.avi\n",
    "#EXTM3U\n#EXT-X-TARGETDURATION:9\n#EXTINF:9,\nhttp://127.0.0.1:9/a.ts\n#EXT-X-ENDLIST\n",
    "v=0\no=- 0 0 IN IP4 127.0.0.1\ns=x\nt=0 0\nm=video 5004 RTP/AVP 96\n",
    "a screen full of text\n" * 500,
)
"""Files that FFmpeg would take for videos, and that name others or none."""
NAMES = ("bad", "bad", "bad", "12:30", "concat:x", "%03d", "\udcff", "a\nb")
"""Names of files without their endings; some mean something to FFmpeg, or are no text in UTF-8."""


LAYOUTS = (
    LAYOUT,
    make_layout(ratex=0, modulation="antipodal", pilots=12),
    make_layout(12, 12, pilots=20),
    make_layout(modulation="antipodal"),
)
TRAIN = ("--episodes", "1", "--rounds", "2", "--steps", "1", "--batch", "1", "--jobs", "1")


KINDS = (
    "manifest", "run", "model", "image", "video", "layout", "key", "training", "settings",
    "command",
)  # fmt: skip
"""What is mutated: names of methods of `Inputs`."""
Case = tuple[str, list[str]]
"""A command's module and its words."""


def mutated_bytes(data: bytes, rng: random.Random) -> bytes:
    """Bytes changed, lost, repeated or moved."""
    array = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 5))):
        at, how = rng.randrange(len(array) + 1), rng.randrange(6)
        if how == 0 and array:
            for place in rng.choices(range(len(array)), k=rng.choice((1, 4, 30))):
                array[place] = rng.randrange(256)
        elif how == 1:
            del array[at:]
        elif how == 2:
            del array[at : at + rng.choice((1, 10, 1000))]
        elif how == 3:
            array[at:at] = array[at : at + 500]
        elif how == 4:
            array[at:at] = rng.randbytes(rng.choice((1, 4, 100)))
        elif array:  # sizes and counts that are too large
            array[at : at + 4] = rng.choice((b"\xff" * 4, b"\0" * 4, b"\x7f\xff\xff\xff"))
    return bytes(array)


def mutated_json(value: Any, rng: random.Random) -> Any:
    """A value of a document replaced, removed, repeated, or wrapped; somewhere in it."""
    if isinstance(value, dict) and value and rng.random() < 0.9:
        key = rng.choice(list(value))
        how = rng.random()
        if how < 0.1:
            return {name: part for name, part in value.items() if name != key}
        if how < 0.15:
            return {**value, rng.choice(("x", "", "meta", "n" * 300)): rng.choice(NASTY)}
        return {**value, key: mutated_json(value[key], rng)}
    if isinstance(value, list) and value and rng.random() < 0.8:
        at = rng.randrange(len(value))
        how = rng.random()
        if how < 0.2:
            return value[:at] + value[at + 1 :]
        if how < 0.3:
            return value + value[at:]
        return [*value[:at], mutated_json(value[at], rng), *value[at + 1 :]]
    return rng.choice(NASTY)


def mutated_text(text: str, rng: random.Random) -> bytes:
    """A JSON document, or a file of JSON lines, changed as values or as bytes."""
    if rng.random() < 0.25:
        return mutated_bytes(text.encode(), rng)
    if rng.random() < 0.06:
        return (rng.choice("[{9") * 10**5).encode()
    if rng.random() < 0.03:
        return text.replace("{", '{"kappa": 3, "kappa": 5, ', 1).encode()
    lines = [text] if text.startswith(("[", "{\n")) else text.splitlines()
    at = rng.randrange(len(lines))
    value = json.loads(lines[at])
    for _ in range(rng.choice((1, 1, 3))):
        value = mutated_json(value, rng)
    lines[at] = json.dumps(value)
    return "\n".join(lines).encode()


def parameters(part: Any) -> dict[str, Any]:
    """The channel's parameters by name, with their values for one camera and display."""
    found: dict[str, Any] = {}
    for name, value in part.items():
        found |= parameters(value) if isinstance(value, dict) else {name: value}
    return found


PARAMETERS = parameters(asdict(get_pair("canon-lg")))


def scaled(value: Any, factor: float) -> Any:
    """A parameter's value with each of its numbers scaled."""
    if isinstance(value, list | tuple):
        return [scaled(part, factor) for part in value]
    if isinstance(value, bool | str) or value is None:
        return value
    scaled_value = value * factor
    return int(scaled_value) if isinstance(value, int) and abs(factor) < 1e9 else scaled_value


class Inputs:
    """Sound inputs, made once, and cases that mutate them by ``rng``.

    A half-finished training in the folder ``training`` is not made here.
    """

    def __init__(self, folder: Path) -> None:
        self.good, self.rng = folder, random.Random()
        draws = np.random.default_rng(0)
        picture = cv2.resize(draws.integers(30, 220, (6, 8, 3)).astype(np.uint8), (512, 384))
        bits = draws.integers(0, 2, LAYOUT.n_bits)
        shown = embed(picture, bits, LAYOUT, 5)
        pilots = embed(picture, draws.integers(0, 2, LAYOUTS[1].n_bits), LAYOUTS[1], 5)
        frames = [cv2.copyMakeBorder(f, 40, 40, 60, 60, cv2.BORDER_CONSTANT) for f in
                  (shown.original, shown.embedded)]  # fmt: skip
        corners = frame_corners(512, 384) + np.array([60, 40])
        captured = Captured(frames[0], frames[1], LAYOUT, corners, corners, bits, 5)
        save_captures(self.good / "captures", iter([captured, captured]))
        for suffix in (".png", ".jpg", ".bmp", ".tiff", ".webp"):
            write_image(self.good / f"photo{suffix}", frames[0])
        for name, frame in zip(("a.png", "b.png"), frames, strict=True):
            write_image(self.good / name, frame)
        states = states_of(TEXT.encode(), LAYOUT, draws)
        for number, state in enumerate(states):
            write_image(self.good / "states" / f"{number:03d}.png", state)
        film = Stream(size=(320, 240)).frames(states, 2, draws)
        write_film(self.good / "film.avi", (image for _, image, _ in film))
        shown_twice = [cv2.copyMakeBorder(f, 40, 40, 60, 60, cv2.BORDER_CONSTANT) for f in
                       (pilots.original, pilots.embedded)]  # fmt: skip
        with_pilots = Captured(shown_twice[0], shown_twice[1], LAYOUTS[1], corners, corners)
        save_captures(self.good / "pilots", iter([with_pilots]))
        for number, layout in enumerate(LAYOUTS):
            (self.good / f"layout{number}.json").write_text(json.dumps(layout.to_dict()))
        (self.good / "key").write_bytes(bytes(range(32)))
        shutil.copytree(PRETRAINED, self.good / "checkpoint")
        write_run(self.good / "run")
        write_report(self.good / "run")

    def manifest(self, folder: Path) -> Case:
        shutil.copytree(self.good / self.rng.choice(("captures", "pilots")), folder / "in")
        file = folder / "in" / MANIFEST
        file.write_bytes(mutated_text(file.read_text(), self.rng))
        flags = ["--captures", str(folder / "in"), "--out", str(folder / "out")]
        flags += ["--methods", "naive", "--jobs", "1", "--no-html"]
        return ("evaluate", flags)

    def run(self, folder: Path) -> Case:
        shutil.copytree(self.good / "run", folder / "in")
        files = [file for file in (folder / "in").rglob("*") if file.is_file()]
        file = self.rng.choice([f for f in files if f.suffix in (".json", ".jsonl")] * 4 + files)
        if self.rng.random() < 0.1:
            file.unlink()
        elif file.suffix in (".json", ".jsonl"):
            file.write_bytes(mutated_text(file.read_text(), self.rng))
        else:
            file.write_bytes(mutated_bytes(file.read_bytes(), self.rng))
        flags = ["--report", str(folder / "in")]
        if self.rng.random() < 0.3:
            flags = ["--compare", str(self.good / "run"), str(folder / "in")]
        return ("evaluate", [*flags, "--out", str(folder / "out")])

    def model(self, folder: Path) -> Case:
        data = MODEL.read_bytes()
        how = self.rng.random()
        if how < 0.02:
            data = self.rng.choice((b"\x3a\x00", b"\x0a\x00", b"\x80\x01")) * 10**7
        elif how < 0.6:
            data = mutated_bytes(data, self.rng)
        else:
            model = onnx.load_from_string(data)
            if how < 0.8:
                entry = self.rng.choice(model.metadata_props)
                text = entry.value if entry.value[:1] in '["{' else json.dumps(entry.value)
                entry.value = mutated_text(text, self.rng).decode(errors="replace")
            else:
                nodes = model.graph.node
                node = self.rng.choice(nodes)
                node.op_type = self.rng.choice([other.op_type for other in nodes])
                value = self.rng.choice(model.graph.initializer)
                if value.dims and self.rng.random() < 0.5:
                    value.dims[0] = self.rng.choice((0, -1, 2**40, 7))
            data = model.SerializeToString()
        (folder / "model.onnx").write_bytes(data)
        images = [str(self.good / "a.png"), str(self.good / "b.png")]
        if self.rng.random() < 0.5:
            return ("export.runtime", [str(folder / "model.onnx"), *images])
        shown = self.rng.choice((images, [str(self.good / "states")]))
        flags = [*shown, "--model", str(folder / "model.onnx")]
        return (RECEIVE, flags)

    def image(self, folder: Path) -> Case:
        source = self.good / f"photo{self.rng.choice(('.png', '.jpg', '.bmp', '.tiff', '.webp'))}"
        file = folder / f"{self.rng.choice(NAMES)}{source.suffix}"
        data, header = source.read_bytes(), 64
        if self.rng.random() < 0.5:  # sizes stand in the first bytes
            file.write_bytes(mutated_bytes(data[:header], self.rng) + data[header:])
        else:
            file.write_bytes(mutated_bytes(data, self.rng))
        if self.rng.random() < 0.3:
            flags = [str(file), "--message", "hi", "--out", str(folder / "out")]
            return ("sender.__main__", flags)
        return ("receiver.locate.__main__", [str(file), "--model", str(MODEL)])

    def video(self, folder: Path) -> Case:
        data = (self.good / "film.avi").read_bytes()
        head = 6000  # where the container describes its streams
        how = self.rng.random()
        if how < 0.1:
            data = self.rng.choice(LISTS).format(good=self.good).encode()
        elif how < 0.7:
            data = mutated_bytes(data[:head], self.rng) + data[head:]
        else:
            data = mutated_bytes(data, self.rng)
        film = folder / f"{self.rng.choice(NAMES)}.{self.rng.choice(('avi', 'avi', 'm3u8'))}"
        film.write_bytes(data)
        if self.rng.random() < 0.1:
            flags = [str(film), "--message", "hi", "--preset", "paper", "--out", "\udcff.mkv"]
            return ("sender.__main__", flags)
        return (RECEIVE, [str(film)])

    def layout(self, folder: Path) -> Case:
        text = (self.good / f"layout{self.rng.randrange(len(LAYOUTS))}.json").read_text()
        (folder / "layout.json").write_bytes(mutated_text(text, self.rng))
        flags = ["--layout", str(folder / "layout.json")]
        if self.rng.random() < 0.5:
            return ("receiver.locate.__main__", [str(self.good / "a.png"), *flags])
        flags += [str(self.good / "a.png"), "--message", "hi", "--out", str(folder / "out")]
        return ("sender.__main__", flags)

    def key(self, folder: Path) -> Case:
        """A key of any length and content, or what is none, and numbers that go with it."""
        file = folder / "key"
        file.write_bytes(self.rng.randbytes(self.rng.choice((0, 1, 15, 16, 32, 4096, 4097, 10**6))))
        name = self.rng.choice((*[str(file)] * 60, *WORDS, str(folder)))
        word = self.rng.choice(WORDS)
        if self.rng.random() < 0.6:
            word = self.rng.choice(("1", "7", str(2**32 - 1), str(2**32)))
        if self.rng.random() < 0.5:
            flags = [str(self.good / "a.png"), "--message", "hi", "--key", name]
            return ("sender.__main__", [*flags, "--counter", word, "--out", "x"])
        flags = [str(self.good / "film.avi"), "--key", name, "--max-age", word]
        return (RECEIVE, flags)

    def training(self, folder: Path) -> Case:
        """A folder of train.py: a training to go on with, a checkpoint to export or evaluate."""
        how = self.rng.randrange(3)
        name, files = "checkpoint", ["config.json", "config.json", "decoder.pt"]
        if how == 0:
            name, files = "training", ["config.json", "state.pt", "state.pt", "log.jsonl"]
        shutil.copytree(self.good / name, folder / "in")
        file = folder / "in" / self.rng.choice(files)
        if self.rng.random() < 0.1:
            file.unlink()
        elif file.suffix == ".pt":
            file.write_bytes(mutated_bytes(file.read_bytes(), self.rng))
        else:
            file.write_bytes(mutated_text(file.read_text(), self.rng))
        if how == 0:
            return ("train", [*TRAIN, "--out", str(folder / "in")])
        if how == 1 and file.suffix == ".pt":
            return ("export.to_onnx", [str(folder / "in")])
        flags = ["--captures", str(self.good / "captures"), "--out", str(folder / "out"), "--jobs"]
        flags += ["1", "--no-html", "--methods", "learned", "--run", str(folder / "in")]
        return ("evaluate", flags)

    def settings(self, folder: Path) -> Case:
        """Values of the channel's parameters, within their limits, beyond them, and of no kind."""
        words = []
        for _ in range(self.rng.choice((1, 1, 2, 4))):
            name = self.rng.choice(list(PARAMETERS))
            number = self.rng.choice((0, 1, -1, 0.5, 2, 3, 90, 1e-9, 1e3, 1e9, 1e308, -1e308))
            value = scaled(PARAMETERS[name], number)
            if self.rng.random() < 0.2:
                value = self.rng.choice((number, [number] * 3, True, *NASTY))
            words.append(f"{name}={json.dumps(value)}".replace("\0", ""))
        flags = ["--rows", "5", "--cols", "5", "--width", "128", "--height", "96", "--set", *words]
        if self.rng.random() < 0.3:
            flags += ["--message", "hi", "--seconds", "0.1", "--size", "160", "120"]
            return ("data_gen.video", [*flags, "--out", str(folder / "out")])
        flags += ["--view", self.rng.choice(("0", "45", "75"))]
        flags += ["--frames", "1", "--out", str(folder / "out")]
        return ("data_gen.__main__", flags)

    def command(self, folder: Path) -> Case:
        """A sound command line with a value, or a flag, replaced by something else."""
        sound = self.rng.choice(SOUND).format(good=self.good, out=folder / "out", model=MODEL)
        module, *words = sound.split()
        for _ in range(self.rng.choice((1, 1, 2))):
            at = self.rng.randrange(len(words))
            how = self.rng.random()
            if how < 0.75:
                word = self.rng.choice(WORDS)
                if self.rng.random() < 0.1:
                    word = "".join(self.rng.choices(string.printable, k=20)).replace("\0", "")
                words[at] = word
            elif how < 0.9:
                del words[at]
            else:
                words.insert(at, self.rng.choice(WORDS))
        return (module, words)
