"""Every command refuses what it cannot use in one line that says what is wrong, and writes nothing.

Numbers of flags are in test_flags.py, and damaged files of stored runs in test_damage.py.
"""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT, Refuses, run_process, slow

from data_gen.pairs import PAIRS
from link.captures import MANIFEST
from link.code import framing
from link.frames import Captured
from link.images import write_image
from link.images.video import write_video
from link.layout import make_layout
from models import DECODERS

LAYOUT = make_layout(5, 6, 120, 80, 2)
MOST_BYTES = framing.capacity(framing.MAX_FRAMES, LAYOUT.n_bits)
"""Length of the longest message that `LAYOUT` carries."""
MODEL = ROOT / "models" / "pretrained" / "ratex" / "decoder.onnx"
PAPER = "--preset paper --rows 5 --cols 6 --width 120 --height 80 --ratex 2"
COMMANDS = {
    "data_gen": ("data_gen.__main__", "--out out"),
    "video": ("data_gen.video", "--message hi --out out"),
    "mp4": ("data_gen.video", "--message hi --seconds 0.1 --out x.mp4"),
    "evaluate": ("evaluate", "--pairs canon-lg --frames 1 --jobs 1 --out out"),
    "captures": ("evaluate", "--methods naive --out {claimed} --captures"),
    "train": ("train", "--episodes 6 --rounds 1 --steps 1 --jobs 1 --out out"),
    "train_films": ("train", "--films --number 1 --seconds 0.1 --out out"),
    "to_onnx": ("export.to_onnx", ""),
    "parity": ("export.parity", ""),
    "runtime": ("export.runtime", f"{MODEL}"),
    "corners": ("export.runtime", f"{MODEL} o.png e.png --corners"),
    "send": ("sender.__main__", f"picture.png --message hi --out x.html {PAPER}"),
    "send hidden": ("sender.__main__", "picture.png --message hi --out x.html"),
    "send layout": ("sender.__main__", "picture.png --message hi --out x.html"),
    "send nothing": ("sender.__main__", ""),
    "send what": ("sender.__main__", f"--out x.html {PAPER}"),
    "receive": ("receiver.__main__", ""),
    "receive film": ("receiver.__main__", "film"),
}
"""Module and first words of each command; a row of the tables gives what it needs besides.

Where a row gives a flag of these words again, that of the row counts. ``{claimed}`` stands for a
folder that evaluate.py claims before it looks at what it is given, and that it may leave.
"""
REFUSED = [
    ("data_gen", "--pair canon-dell", ("'canon-dell'", *PAIRS)),
    ("data_gen", "--kappa 0", "--kappa: need 1 to 64"),
    ("data_gen", "--view 89", "--view: need an angle within ±75 degrees"),
    ("data_gen", "--ratex 4", "--ratex: choose"),
    ("data_gen", "--without rain", "effect 'rain'; choose one of: perspective"),
    ("data_gen", "--set jpeg_quality=200", "jpeg_quality must lie in [0, 100]"),
    ("data_gen", "--set blur_px=true", "blur_px must be a number in [0, 10], got True"),
    ("data_gen", "--width 20", "need a frame of at least"),
    ("data_gen", "--split dev", "train, test"),
    ("data_gen", "--pictures nowhere", "nowhere: no such folder"),
    ("data_gen", "--out text.png --frames 1", "text.png"),
    ("video", "--out x.txt", "--out: need a folder, or a file of .mkv, .avi, .mp4, .mov that"),
    ("video", "--coverage 2", "--coverage: need 0.05 to 0.9 of the image"),
    ("video", "--without perspective", "a scene needs perspective"),
    ("mp4", "--out x.webm", "--out: need a folder, or a file of .mkv, .avi, .mp4, .mov"),
    ("mp4", "--codec.kbits 1", "--codec.kbits: need 50 to 500000 kbit/s"),
    ("evaluate", "--pairs canon-dell", tuple(PAIRS)),
    ("evaluate", "--methods idol", f"method 'idol'; choose one of: {', '.join(DECODERS)}"),
    ("evaluate", "--methods oorc --run many", "--run: is a checkpoint of learned, which is not"),
    ("evaluate", "--out many", "--out: many holds a run with other settings, or other files"),
    ("evaluate", "--views 45 45", "--views: name at least one, and none twice"),
    ("evaluate", "--protocol papr", "protocol 'papr'; choose one of: fair, paper"),
    ("evaluate", "--set drift", "--set: need name=value"),
    ("evaluate", "--captures many --sent many --view -90", "--view: need an angle below 90"),
    ("captures", "nowhere", "manifest.jsonl"),
    ("captures", "none", f"{MANIFEST}: not found"),
    ("train", "--pair canon-dell", ("'canon-dell'", *PAIRS)),
    ("train_films", "--lr -1", "--lr: need more than 0"),
    ("train_films", "--filmed paper", "--filmed: paper is read by frame pairs"),
    ("to_onnx", "none", "config.json: not found; train first"),
    ("parity", "none", "config.json: not found; train first"),
    ("runtime", "gone.png e.png", "gone.png: no such image file"),
    ("runtime", "text.png e.png", "text.png: not a readable image"),
    ("runtime", "o.png narrow.png", "original is 768x576 and embedded is 668x576"),
    ("runtime", "o.png e.png", "no ratex patches"),
    ("corners", "10,10 900,10 700,500 10,500", "(900, 10) lies outside the 768x576 image"),
    ("corners", "10,10 700,10 700,500 10", "--corners: need four points x,y"),
    ("corners", "10,10 10,500 700,500 700,10", "not a convex quadrilateral"),
    ("send what", "gone.png --message hi", "gone.png: no such image, folder"),
    ("send what", "text.mp4 --message hi", "text.mp4: not a readable video"),
    ("send what", "cut.avi --message hi", "cut.avi: the video breaks off after"),
    ("send what", "none --message hi", "none: no image in this folder"),
    ("send what", "picture.png", "either --message TEXT or --file FILE"),
    ("send what", "picture.png --file empty.txt", "empty; give at least one byte"),
    ("send what", "picture.png --file gone.txt", "--file: gone.txt: no such file"),
    ("send what", "picture.png --file /dev/zero", "--file: /dev/zero: is a folder or a"),
    ("send what", "picture.png --file clip.avi", f"carries {MOST_BYTES}; shorten"),
    ("send what", "picture.png --message=", "--message: empty"),
    ("send nothing", "picture.png --message hi", "arguments are required: --out; see --help"),
    ("send", "--key gone", "--key: gone: no such file; check the path"),
    ("send", "--key empty.txt", "--key: empty.txt: need 16 to 4096 random bytes"),
    ("send", "--key picture.png", "--key: picture.png: larger than 4096 bytes"),
    ("send", "--key key --counter -1", "--counter: need at least 0, got -1"),
    ("send", "--counter 1", "--counter: only a message with a key has one"),
    ("send", "--kappa much", "argument --kappa: invalid int value: 'much'"),
    ("send", "--out x.mp4", "x.mp4 must end in .html, .avi or .mkv"),
    ("send", "--out .html", ".html must end in .html, .avi or .mkv"),
    ("send", "--out clip.avi", "--out: clip.avi is already there"),
    ("send", "--out many", "--out: many is already there"),
    ("send", "--out /", "--out: / has no name"),
    ("send", "--out text.png/x", "text.png: cannot be made a folder"),
    ("send", "--refresh 1e5 --hold 4", "need 0.1 to 1000 a second, got 25000"),
    ("send hidden", "--hold 3", "20 states a second: receivers find the code of this"),
    ("send", "--preset loud", "argument --preset: invalid choice: 'loud' (choose from"),
    ("send", "--rows 2", "layout: 10 message blocks a frame"),
    ("send", "--out x.mkv --size 121x80", "even widths and heights only, got 121x80"),
    ("send", "--color red", "unrecognized arguments: --color red; see --help"),
    ("send", "--visibility 1 --kappa 1", "--visibility and --kappa: give one"),
    ("send", "--visibility 0.5", "--visibility: a kappa of 1 is at "),
    ("send", "--luminance 0.5", "--luminance: need 1 to 100000, got 0.5"),
    ("send layout", "--layout bad.json", "bad.json: no layout there"),
    ("send layout", "--layout layout.json --rows 5", "--rows and --layout: give one"),
    ("receive", "gone", "no such folder, video file, camera number or device"),
    ("receive", "none", "no image in this folder"),
    ("receive", "text.mp4", "not a readable video"),
    ("receive", "picture.png", "picture.png: one image is no film; give both"),
    ("receive film", "--key short", "--key: short: need 16 to 4096 random bytes"),
    ("receive film", "--max-age 5", "--max-age: only a message with a key has an age"),
    ("receive film", "other.png --keep-on", "--keep-on: two images are one frame pair"),
    ("receive film", "other.png --fps 60", "--fps: two images are one frame pair"),
    ("receive film", "--out=", "--out: empty; give a name"),
    ("receive film", "--out .", "--out: . is a folder or a device; name a file"),
]
BEGAN = [
    ("data_gen", "--out taken", "00000_original.png is there already; choose another name"),
    ("mp4", "--size 161 96", "h264: need an even width and height, got 161"),
    slow("evaluate", "--run nowhere --out {claimed}", "nowhere/config.json: not found"),
]
"""What is found wrong when the work has begun, and progress has been shown."""


@pytest.fixture(scope="module")
def inputs(captured: Captured, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of good and bad files: one of each kind that a command takes."""
    folder = tmp_path_factory.mktemp("inputs")
    rng = np.random.default_rng(0)
    pictures = rng.integers(0, 256, (2, 80, 120, 3), dtype=np.uint8)
    write_image(folder / "picture.png", pictures[0])
    write_image(folder / "many" / "00.png", pictures[1])
    write_image(folder / "o.png", captured.original)
    write_image(folder / "e.png", captured.embedded)
    write_image(folder / "narrow.png", captured.embedded[:, :-100])
    (folder / "none").mkdir()
    (folder / "none" / "notes.txt").write_text("no image")
    (folder / "taken" / "00000_original.png").mkdir(parents=True)
    (folder / "text.png").write_text("no image")
    (folder / "text.mp4").write_text("no video")
    (folder / "empty.txt").write_bytes(b"")
    (folder / "bad.json").write_text("{")
    (folder / "key").write_bytes(bytes(range(32)))
    (folder / "short").write_bytes(bytes(9))
    (folder / "layout.json").write_text(json.dumps(LAYOUT.to_dict()))
    video = folder / "clip.avi"
    write_video(video, (np.full((80, 120, 3), number, np.uint8) for number in range(60)), 30)
    (folder / "cut.avi").write_bytes(video.read_bytes()[: video.stat().st_size // 3])
    return folder


Refuse = Callable[..., None]


@pytest.fixture
def refuse(inputs: Path, tmp_path: Path, refuses: Refuses) -> Refuse:
    """Run a command of `COMMANDS` beside the inputs, with some more words."""

    def run(name: str, words: str, *says: str, began: bool = False) -> None:
        module, first = COMMANDS[name]
        line = f"{first} {words}".format(claimed=tmp_path / "out")
        refuses(module, line, *says, began=began, folder=inputs)

    return run


@pytest.mark.parametrize(("name", "words", "says"), REFUSED)
def test_a_command_refuses_what_it_cannot_use_in_one_line(
    name: str, words: str, says: str | tuple[str, ...], refuse: Refuse
) -> None:
    refuse(name, words, *((says,) if isinstance(says, str) else says))


@pytest.mark.parametrize(("name", "words", "says"), BEGAN)
def test_a_command_that_has_begun_ends_in_one_line(
    name: str, words: str, says: str, refuse: Refuse
) -> None:
    refuse(name, words, says, began=True)


def test_every_command_prints_its_refusals_in_one_line() -> None:
    """What starts a command as a user does is the last line of its file."""
    where = ("--", "*.py", ":!tests", ":!*_worker.py")
    found = run_process("git", "grep", "-lE", r"^def main\(\)", *where)
    files = [ROOT / file for file in found.stdout.split()]
    assert len(files) > 12
    end = 'if __name__ == "__main__":\n    run_cli(main)\n'
    assert [file for file in files if not file.read_text().endswith(end)] == []
