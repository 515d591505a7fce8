"""Settings of a comparison: the sweeps that they ask for, and those that decide its result.

Settings are compared with the usual ones, which are the defaults of the command's flags.
"""

from collections.abc import Sequence
from dataclasses import asdict, fields
from typing import Any

from data_gen.flags import LayoutFlags, SourceFlags
from link.errors import InputError
from link.layout import Layout
from reports.engine.methods import Method
from reports.engine.predict import checkpoint_digest
from reports.evaluation.sweeps import SWEEPS

UNDECISIVE = ("out", "jobs", "backend", "scheduler", "show", "html", "report", "compare")
"""Flags that decide no number, and so are no part of a run's settings."""
REFERENCE = ("pairs", "views", "kappas", "pictures", "without", "set")
"""Flags that the reference comparison, with the paper's 36 cells, leaves as they usually are."""
OF_SIMULATION = (*REFERENCE, "frames", "sweeps", "quick", "ratex")
"""Settings that say what is simulated. They say nothing of captures from a folder."""
OF_BENCHMARK = (
    *REFERENCE,
    "films",
    "frames",
    "sweeps",
    "quick",
    "captures",
    "ablation",
    "protocol",
)
"""Flags that have no effect with --benchmark, which fixes its conditions, and so are refused."""


def check_benchmark(config: SourceFlags) -> None:
    """Raise an `InputError` that names the first flag that is set although --benchmark fixes it.

    Args:
        config: settings of evaluate.py.
    """
    usual = type(config)()
    for flag in OF_BENCHMARK:
        if getattr(config, flag) != getattr(usual, flag):
            raise InputError(f"--benchmark: has conditions of its own; leave out --{flag}")


def chosen_sweeps(config: LayoutFlags, named: Sequence[str] | None) -> tuple[str, ...]:
    """List the sweeps that were named, or all of them beside the reference comparison.

    Args:
        config: settings of evaluate.py.
        named: value of --sweeps, None where absent.
    """
    if named is not None:
        return tuple(named)
    usual = type(config)()
    whole = not getattr(config, "ablation", False) and all(
        getattr(config, flag) == getattr(usual, flag) for flag in REFERENCE
    )
    whole &= config.layout() == usual.layout()
    return tuple(SWEEPS) if whole else ()


def decisive_settings(
    config: SourceFlags, methods: Sequence[Method], layouts: Sequence[Layout]
) -> dict[str, Any]:
    """Name all that decides the result: flags, and digests of the checkpoints.

    Args:
        config: settings of evaluate.py.
        methods: methods that are compared.
        layouts: layouts of the frame pairs on which they are compared.
    """
    layout = config.layout()
    flags = {field.name for field in fields(LayoutFlags)}
    settings = {k: v for k, v in asdict(config).items() if k not in (*UNDECISIVE, *flags)}
    settings |= {flag: getattr(layout, flag) for flag in sorted(flags)}
    settings["ratex"] = len(layout.ratex)
    return {**settings, "checkpoints": {m.name: checkpoint_digest(m, *layouts) for m in methods}}
