"""Checkpoints: decoder.pt (a state_dict) and config.json, loaded strictly."""

import hashlib
import io
import json
import pickle
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import torch
from torch import nn

from link.errors import InputError, UnsuitedError
from link.images import write_bytes
from link.layout import Layout
from models.neural.decoder import DecoderConfig, PhiDecoder

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

DAMAGE = (RuntimeError, pickle.UnpicklingError, EOFError, ValueError, TypeError, LookupError)
"""What torch.load and load_state_dict raise on damaged files."""


class Saveable(Protocol):
    """A module that can say what it takes to rebuild it."""

    def state_dict(self) -> dict[str, Any]:
        """Its weights."""
        ...

    def to_config(self) -> dict[str, object]:
        """All else."""
        ...


def save_checkpoint(folder: Path, module: Saveable, extra: dict[str, Any]) -> None:
    """Write decoder.pt and config.json into ``folder``; ``extra`` says how it was trained."""
    buffer = io.BytesIO()
    torch.save(module.state_dict(), buffer)
    write_bytes(folder / "decoder.pt", buffer.getvalue())
    digest = hashlib.sha256(buffer.getvalue()).hexdigest()
    config = {**module.to_config(), **extra, "sha256": digest}
    write_bytes(folder / "config.json", (json.dumps(config, indent=2) + "\n").encode())


def training_settings(config: "DataclassInstance") -> dict[str, Any]:
    """What a checkpoint and its export say of their training: the flags as JSON, but no folder."""
    settings: dict[str, Any] = json.loads(json.dumps(asdict(config), default=str))
    return {name: value for name, value in settings.items() if name != "out"}


def load_checkpoint(folder: Path, layout: Layout | None = None) -> PhiDecoder:
    """Rebuild the decoder saved in ``folder``.

    Its learned parameters do not depend on the layout, so it may be loaded for another one.

    Args:
        folder: with decoder.pt and config.json.
        layout: in place of the saved one.

    Raises:
        InputError: a file is missing, damaged, or does not fit the other.
    """
    config = read_config(folder)
    try:
        saved_layout = Layout.from_dict(config["layout"])
        module = PhiDecoder(layout or saved_layout, DecoderConfig(**config["decoder"]))
    except UnsuitedError:
        if layout is not None:
            raise
        raise InputError(f"{folder / 'config.json'}: its layout has no ratex patch") from None
    except (ValueError, KeyError, TypeError) as error:
        file = folder / "config.json"
        raise InputError(f"{file}: not a decoder configuration ({error})") from None
    load_weights(folder, config, module)
    return module


def read_config(folder: Path, command: str = "python train.py --pair NAME") -> dict[str, Any]:
    """Read a checkpoint's config.json.

    Args:
        folder: with decoder.pt and config.json.
        command: that writes such a checkpoint, for the error message.

    Raises:
        InputError: a file is missing, or config.json is damaged.
    """
    for file in (folder / "config.json", folder / "decoder.pt"):
        if not file.is_file():
            raise InputError(f"{file}: not found; train first: {command}")
    try:
        config = json.loads((folder / "config.json").read_text())
        str(config["sha256"])
    except (ValueError, KeyError, TypeError) as error:
        file = folder / "config.json"
        raise InputError(f"{file}: not a decoder configuration ({error})") from None
    return dict(config)


def load_weights(folder: Path, config: dict[str, Any], module: nn.Module) -> None:
    """Load decoder.pt into the module that its ``config`` describes.

    Raises:
        InputError: the file is damaged, or does not fit the module.
    """
    weights_file = folder / "decoder.pt"
    data = weights_file.read_bytes()
    if hashlib.sha256(data).hexdigest() != config["sha256"]:
        raise InputError(f"{weights_file}: differs from the sha256 in config.json; train again")
    try:
        module.load_state_dict(torch.load(io.BytesIO(data), weights_only=True), strict=True)
    except DAMAGE as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(f"{weights_file}: does not fit config.json ({reason})") from None
    if not all(torch.isfinite(p).all() for p in module.parameters()):
        raise InputError(f"{weights_file}: contains values that are not finite; train again")


def save_state(
    file: Path,
    parts: dict[str, Any],
    generator: torch.Generator,
    key: str,
    done: int,
    log: list[dict[str, Any]],
) -> None:
    """Write all that training needs to go on after ``done`` rounds; ``key`` names its settings."""
    state = {name: part.state_dict() for name, part in parts.items()}
    state |= {"generator": generator.get_state(), "key": key, "done": done, "log": log}
    buffer = io.BytesIO()
    torch.save(state, buffer)
    write_bytes(file, buffer.getvalue())


def resume_state(
    file: Path, parts: dict[str, Any], generator: torch.Generator, key: str
) -> tuple[int, list[dict[str, Any]]]:
    """Restore what `save_state` wrote, where it has the same ``key``; else start anew.

    Returns:
        the number of rounds already made, and their log.

    Raises:
        InputError: the file is damaged.
    """
    if not file.is_file():
        return 0, []
    try:
        state = torch.load(file, weights_only=True)
        if state["key"] != key:
            return 0, []
        for name, part in parts.items():
            part.load_state_dict(state[name])
        generator.set_state(state["generator"])
        return state["done"], state["log"]
    except DAMAGE:
        raise InputError(f"{file}: damaged; delete it to start anew") from None
