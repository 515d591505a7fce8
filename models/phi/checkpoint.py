"""Checkpoints of trained modules, and the state from which a training that was cut off goes on.

A checkpoint is a folder with decoder.pt, which holds the weights, and config.json, which holds all
that is needed to rebuild the module around them.
"""

import hashlib
import io
import json
import pickle
import struct
import zipfile
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch
from torch import nn

from link.errors import InputError, UnsuitedError
from link.images import write_bytes
from link.layout import Layout
from link.outside import is_file, read_bounded, read_json
from models import shipped_checkpoint
from models.phi.config import DecoderConfig
from models.phi.decoder import PhiDecoder

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

DAMAGE = (
    AttributeError, EOFError, LookupError, pickle.UnpicklingError, RuntimeError, struct.error,
    TypeError, ValueError, zipfile.BadZipFile,
)  # fmt: skip
"""Exceptions that `unpack` and load_state_dict raise on damaged files."""
MAX_WEIGHTS_BYTES = 256 * 2**20
"""Largest size, in bytes, of a decoder.pt that is read."""
MAX_STATE_BYTES = 3 * MAX_WEIGHTS_BYTES
"""Largest size, in bytes, of the state of a training that is read: the optimiser keeps two numbers
beside each weight."""


def save_checkpoint(folder: Path, module: nn.Module, config: dict[str, Any]) -> None:
    """Write decoder.pt and config.json into an existing folder.

    Args:
        folder: where both files are written.
        module: the module whose weights are written.
        config: entries of config.json: what the module is rebuilt from, where it has a choice, and
            how it was trained.
    """
    buffer = io.BytesIO()
    torch.save(module.state_dict(), buffer)
    write_bytes(folder / "decoder.pt", buffer.getvalue())
    digest = hashlib.sha256(buffer.getvalue()).hexdigest()
    text = json.dumps({**config, "sha256": digest}, indent=2)
    write_bytes(folder / "config.json", f"{text}\n".encode())


def training_settings(config: "DataclassInstance") -> dict[str, Any]:
    """Turn the flags of a training into JSON values for the checkpoint and its export.

    Folders and files are left out, because they say nothing to a reader on another machine.
    """
    kept = {
        name: value
        for name, value in asdict(config).items()
        if name != "out" and not isinstance(value, Path)
    }
    settings: dict[str, Any] = json.loads(json.dumps(kept, default=str))
    return settings


def load_checkpoint(folder: Path, layout: Layout | None = None) -> PhiDecoder:
    """Rebuild the decoder saved in ``folder``.

    Its learned parameters do not depend on the grid, so it may be loaded for another one, as long
    as both layouts have ratex patches, or both have pilots.

    Args:
        folder: folder with decoder.pt and config.json.
        layout: layout of the frames to decode, in place of the saved one.

    Raises:
        InputError: a file is missing, damaged, or does not fit the other.
        UnsuitedError: the given layout has neither ratex patches nor pilots.

    >>> from models import PRETRAINED
    >>> decoder = load_checkpoint(PRETRAINED)
    >>> decoder.config.degree, decoder.layout.n_bits
    (4, 59)
    >>> sum(parameter.numel() for parameter in decoder.parameters())
    59
    """
    config = read_config(folder)
    try:
        saved_layout = Layout.from_dict(config["layout"])
        if layout is not None and bool(layout.pilots) != bool(saved_layout.pilots):
            kinds = [
                ("pilots" if each.pilots else "ratex patches") for each in (saved_layout, layout)
            ]
            raise UnsuitedError(
                f"{folder} was trained on layouts with {kinds[0]}, not with {kinds[1]}; take "
                f"{shipped_checkpoint(layout)} or a run that was"
            )
        module = PhiDecoder(layout or saved_layout, DecoderConfig(**config["decoder"]))
    except UnsuitedError:
        if layout is not None:
            raise
        raise InputError(
            f"{folder / 'config.json'}: its layout has neither ratex patches nor pilots"
        ) from None
    except (ValueError, KeyError, TypeError) as error:
        file = folder / "config.json"
        raise InputError(f"{file}: not a decoder configuration ({error})") from None
    load_weights(folder, config, module)
    return module


def read_config(folder: Path) -> dict[str, Any]:
    """Read a checkpoint's config.json.

    Args:
        folder: folder with decoder.pt and config.json.

    Raises:
        InputError: a file is missing, or config.json is damaged.
    """
    for file in (folder / "config.json", folder / "decoder.pt"):
        if not is_file(file):
            raise InputError(f"{file}: not found; train first: python train.py --pair NAME")
    file = folder / "config.json"
    try:
        config = read_json(file)
    except InputError as error:
        raise InputError(f"{file}: not a decoder configuration ({error})") from None
    if not isinstance(config, dict) or not isinstance(config.get("sha256"), str):
        raise InputError(f"{file}: not a decoder configuration (no object with a sha256)")
    return config


def load_weights(folder: Path, config: dict[str, Any], module: nn.Module) -> None:
    """Load decoder.pt into the module that config.json describes.

    Args:
        folder: folder with decoder.pt.
        config: content of config.json, as `read_config` returns it.
        module: module that was built from this configuration; its weights are replaced.

    Raises:
        InputError: the file is damaged, or does not fit the module.
    """
    weights_file = folder / "decoder.pt"
    data = read_bounded(weights_file, MAX_WEIGHTS_BYTES)
    if hashlib.sha256(data).hexdigest() != config["sha256"]:
        raise InputError(f"{weights_file}: differs from the sha256 in config.json; train again")
    try:
        module.load_state_dict(unpack(data), strict=True)
    except DAMAGE as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(f"{weights_file}: does not fit config.json ({reason})") from None
    if not all(torch.isfinite(p).all() for p in module.parameters()):
        raise InputError(f"{weights_file}: contains values that are not finite; train again")


def unpack(data: bytes) -> Any:
    """Read what torch.save wrote, or raise one of `DAMAGE`.

    torch compresses nothing. A file of 1 MB whose parts are compressed can take up 1 GB of memory.
    """
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        parts = archive.infolist()
    stored = all(part.compress_type == zipfile.ZIP_STORED for part in parts)
    if not stored or sum(part.file_size for part in parts) > len(data):
        raise ValueError("it is compressed; save it with torch.save")
    return torch.load(io.BytesIO(data), "cpu", weights_only=True)


def save_state(
    file: Path,
    parts: dict[str, Any],
    generator: torch.Generator,
    key: str,
    done: int,
    log: list[dict[str, Any]],
) -> None:
    """Write all that a training needs to go on after ``done`` rounds.

    Args:
        file: file to write.
        parts: module, optimiser and whatever else has a ``state_dict``, by name.
        generator: source of the training's random draws.
        key: text that names the settings and the code; another key does not go on from here.
        done: number of rounds made so far.
        log: entries of the training's log so far, one a step.
    """
    state = {name: part.state_dict() for name, part in parts.items()}
    state |= {"generator": generator.get_state(), "key": key, "done": done, "log": log}
    buffer = io.BytesIO()
    torch.save(state, buffer)
    write_bytes(file, buffer.getvalue())


def resume_state(
    file: Path, parts: dict[str, Any], generator: torch.Generator, key: str
) -> tuple[int, list[dict[str, Any]]]:
    """Restore what `save_state` wrote if it has the same key; otherwise leave all as it is.

    Args:
        file: file that `save_state` may have written.
        parts: module, optimiser and whatever else has a ``load_state_dict``, by name.
        generator: source of the training's random draws, whose state is set.
        key: text that names the settings and the code.

    Returns:
        the number of rounds already made, and the entries of their log; 0 and none for a new
        training.

    Raises:
        InputError: the file is damaged, or larger than `MAX_STATE_BYTES`.
    """
    if not is_file(file):
        return 0, []
    data = read_bounded(file, MAX_STATE_BYTES)
    try:
        state = unpack(data)
        if state["key"] != key:
            return 0, []
        for name, part in parts.items():
            part.load_state_dict(state[name])
        generator.set_state(state["generator"])
        return state["done"], state["log"]
    except DAMAGE:
        raise InputError(f"{file}: damaged; delete it to start anew") from None
