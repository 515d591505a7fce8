"""Each other system as: a picture and bits -> a picture; a picture -> scores.

They are watermarks of one still picture, from packages that are an optional extra. Arguments and
decisions are the packages' own; only their strength is set.
"""

import multiprocessing
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from link.errors import InputError, choose

# Without their dependencies: both ask for opencv-python, which overwrites our headless build.
INSTALL = (
    "pip install -e '.[peers]' && "
    "pip install --no-deps invisible-watermark==0.2.0 blind-watermark==0.4.4"
)
"""Command that installs the packages of all systems."""
RIVAGAN_BITS = 32
"""Number of message bits of rivaGAN."""

RgbPicture = NDArray[np.uint8]
"""(H, W, 3) RGB, encoded; at least 256 x 256 pixels in all."""


class Peer(Protocol):
    """A system that hides bits in a still picture."""

    @property
    def name(self) -> str:
        """What tables call the system."""
        ...

    @property
    def strength(self) -> str:
        """How strongly it embeds, in its own unit; "default" is the package's own choice."""
        ...

    @property
    def n_bits(self) -> int:
        """Number of message bits in a picture."""
        ...

    def embed(self, picture: RgbPicture, bits: NDArray[np.intp]) -> RgbPicture:
        """Hide (n_bits,) bits of 0 or 1 in a picture; what comes back has its shape."""
        ...

    def extract(self, picture: RgbPicture) -> NDArray[np.float64]:
        """Read (n_bits,) scores from a picture; a positive score means 1."""
        ...


@dataclass(frozen=True)
class InvisibleWatermark:
    """`dwtDct` or `dwtDctSvd` of the package invisible-watermark: quantised coefficients."""

    family: str
    """Name of the system where it marks the default channel."""
    method: str
    """Name that the package gives to the system."""
    scale: int
    """Quantisation step; the package's default is 36."""
    n_bits: int
    """Number of message bits in a picture."""
    channel: str = "U"
    """Channel of YUV that holds the bits: the package's default is U, and Y is the other."""

    @property
    def name(self) -> str:
        """Family, and the channel where it is not the default."""
        return self.family if self.channel == "U" else f"{self.family} in {self.channel}"

    @property
    def strength(self) -> str:
        """Scale in words, "default" for the package's own."""
        return "default" if (self.channel, self.scale) == ("U", 36) else f"scale {self.scale}"

    def embed(self, picture: RgbPicture, bits: NDArray[np.intp]) -> RgbPicture:
        """Mark a picture by the package."""
        encoder = _package("imwatermark", self.name).WatermarkEncoder()
        encoder.set_watermark("bits", bits.tolist())
        return _rgb(encoder.encode(_bgr(picture), self.method, scales=self._scales()))

    def extract(self, picture: RgbPicture) -> NDArray[np.float64]:
        """Read a picture by the package."""
        decoder = _package("imwatermark", self.name).WatermarkDecoder("bits", self.n_bits)
        return _signs(decoder.decode(_bgr(picture), self.method, scales=self._scales()))

    def _scales(self) -> list[int]:
        """Quantisation steps of Y, U and V; the package never reads the last."""
        return [self.scale if name == self.channel else 0 for name in "YUV"]


@dataclass(frozen=True)
class RivaGan:
    """The network of Zhang et al. 2019, as invisible-watermark ships it."""

    gain: float = 1.0
    """Factor on what the network adds to the picture. The package has no such parameter: it is
    ours, so that the network can be compared at other visibilities."""
    name: str = "rivaGAN"
    """What tables call the system."""
    n_bits: int = RIVAGAN_BITS
    """Number of message bits in a picture."""

    @property
    def strength(self) -> str:
        """Gain in words, "default" for the package's own."""
        return "default" if self.gain == 1 else f"residual x {self.gain:g}"

    def embed(self, picture: RgbPicture, bits: NDArray[np.intp]) -> RgbPicture:
        """Mark a picture by the network, and scale what it added."""
        self._load()
        encoder = _package("imwatermark", self.name).WatermarkEncoder()
        encoder.set_watermark("bits", bits.tolist())
        marked = _rgb(encoder.encode(_bgr(picture), "rivaGan"))
        residual = marked.astype(np.float64) - picture
        return np.clip(np.rint(picture + self.gain * residual), 0, 255).astype(np.uint8)

    def extract(self, picture: RgbPicture) -> NDArray[np.float64]:
        """Read a picture by the network."""
        self._load()
        decoder = _package("imwatermark", self.name).WatermarkDecoder("bits", self.n_bits)
        return _signs(decoder.decode(_bgr(picture), "rivaGan"))

    def _load(self) -> None:
        """Load the network once, held to one thread, as all that is timed here."""
        module = _package("imwatermark.rivaGan", self.name)
        if module.RivaWatermark.encoder is None:
            encoder, decoder = _sessions(Path(module.__file__).parent)
            module.RivaWatermark.encoder, module.RivaWatermark.decoder = encoder, decoder


@dataclass(frozen=True)
class BlindWatermark:
    """The package blind-watermark: singular values of DCT blocks, in all three channels."""

    steps: tuple[int, int] = (36, 20)
    """Quantisation of the first two singular values (d1, d2); 36 and 20 by default."""
    n_bits: int = 32
    """Number of message bits in a picture."""
    name: str = "blind-watermark"
    """What tables call the system."""

    @property
    def strength(self) -> str:
        """Quantisation steps in words, "default" for the package's own."""
        return "default" if self.steps == (36, 20) else f"d1 {self.steps[0]}, d2 {self.steps[1]}"

    def embed(self, picture: RgbPicture, bits: NDArray[np.intp]) -> RgbPicture:
        """Mark a picture by the package."""
        mark = self._mark()
        mark.read_img(img=_bgr(picture))
        mark.read_wm(bits.tolist(), mode="bit")
        return _rgb(np.clip(np.rint(mark.embed()), 0, 255).astype(np.uint8))

    def extract(self, picture: RgbPicture) -> NDArray[np.float64]:
        """Read a picture: the package splits the blocks' means into two clusters."""
        with np.errstate(invalid="ignore"):
            found = self._mark().extract(embed_img=_bgr(picture), wm_shape=self.n_bits, mode="bit")
        return _signs(found)

    def _mark(self) -> Any:
        module = _package("blind_watermark", self.name)
        module.bw_notes.close()
        mark = module.WaterMark()
        mark.bwm_core.d1, mark.bwm_core.d2 = self.steps
        return mark


def _quantisers(name: str, method: str, n_bits: int) -> list[Peer]:
    strengths = [("U", 18), ("U", 36), ("U", 72), ("U", 144), ("Y", 36), ("Y", 144)]
    return [InvisibleWatermark(name, method, step, n_bits, channel) for channel, step in strengths]


PEERS: dict[str, Callable[[int], list[Peer]]] = {
    "rivaGAN": lambda n_bits: [RivaGan(gain) for gain in (1.0, 2.0, 4.0)],
    "DWT-DCT": lambda n_bits: _quantisers("DWT-DCT", "dwtDct", n_bits),
    "DWT-DCT-SVD": lambda n_bits: _quantisers("DWT-DCT-SVD", "dwtDctSvd", n_bits),
    "blind-watermark": lambda n_bits: [
        BlindWatermark(steps, n_bits) for steps in ((18, 10), (36, 20), (72, 40), (144, 80))
    ],
}
"""Systems by name: the system at each strength, for a number of message bits. rivaGAN has 32."""
IMPORTED = {
    "rivaGAN": "imwatermark",
    "DWT-DCT": "imwatermark",
    "DWT-DCT-SVD": "imwatermark",
    "blind-watermark": "blind_watermark",
}
"""Module that each system imports."""


def make_peers(name: str, n_bits: int) -> list[Peer]:
    """Make a system at each of its strengths.

    Raises:
        InputError: the name is unknown (the message lists the valid ones), or its package is not
            installed.
    """
    peers = choose(PEERS, name, "system")(n_bits)
    if name in IMPORTED:
        _package(IMPORTED[name], name)
    return peers


@lru_cache(maxsize=4)
def _package(module: str, name: str) -> Any:
    """Import a peer's module; blind_watermark's choice of how processes start is undone."""
    method = multiprocessing.get_start_method(allow_none=True)
    try:
        multiprocessing.set_start_method(None, force=True)
        return import_module(module)
    except ModuleNotFoundError as error:
        raise InputError(f"{name}: the package {error.name} is missing; run {INSTALL}") from None
    finally:
        multiprocessing.set_start_method(method, force=True)


@lru_cache(maxsize=1)
def _sessions(folder: Path) -> tuple[Any, Any]:
    """rivaGAN's encoder and decoder, which the wheel holds."""
    runtime = import_module("onnxruntime")
    options = runtime.SessionOptions()
    options.intra_op_num_threads = 1
    files = (folder / f"rivagan_{part}.onnx" for part in ("encoder", "decoder"))
    encoder, decoder = (runtime.InferenceSession(str(file), options) for file in files)
    return encoder, decoder


def _bgr(picture: RgbPicture) -> RgbPicture:
    return np.asarray(cv2.cvtColor(picture, cv2.COLOR_RGB2BGR), np.uint8)


def _rgb(picture: Any) -> RgbPicture:
    return np.asarray(cv2.cvtColor(np.asarray(picture, np.uint8), cv2.COLOR_BGR2RGB), np.uint8)


def _signs(bits: Any) -> NDArray[np.float64]:
    """Hard decisions as scores of -1 and 1."""
    return np.where(np.asarray(bits, bool), 1.0, -1.0)
