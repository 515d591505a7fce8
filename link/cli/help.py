"""Set the help that tyro prints as argparse sets its own, so that all commands have one style.

Flags that must be given come first, and those come last that describe the layout and the
simulation, which many commands share. Lines are filled; tyro keeps some breaks of the source.
"""

import re
import sys
from argparse import Action, HelpFormatter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

SHARED = (
    *("rows", "cols", "width", "height", "ratex", "modulation", "pilots", "colour"),
    *("display-size", "even", "seed", "pictures", "without", "set"),
)
"""Flags that many commands share (`data_gen.flags.SourceFlags`)."""
SHARED_TITLE = "the layout and the simulation, as in other commands"
"""Title above the flags of `SHARED`."""
ENTRY = re.compile(r"^  (-\S.*?|[\[{A-Z]\S*)(?:  +(\S.*))?$")
"""Pattern of the line of a flag or an input: its names and value, then its help, if it fits."""
NO_DEFAULT = re.compile(r" \(default: (None)?\)$")
"""Pattern of a default that says nothing."""


@dataclass
class Section:
    """Flags under one title."""

    title: str
    """Title, as tyro words it."""
    entries: list[list[str]] = field(default_factory=list)
    """By flag its names and value, and its help."""


def sections_of(printed: str) -> tuple[str, list[Section]]:
    """Take apart what tyro printed: the description of the command, and its sections."""
    head, sections = [], [Section("")]
    for line in map(str.rstrip, printed.splitlines()):
        entry = ENTRY.match(line)
        if line.strip("- ") == "" and line:
            continue
        if re.match(r" \S", line):
            sections.append(Section(line.strip()))
        elif len(sections) == 1:
            head.append("" if line.startswith("usage:") else line)
        elif entry:
            sections[-1].entries.append([entry[1], entry[2] or ""])
        elif line.startswith("    ") and sections[-1].entries:
            sections[-1].entries[-1][1] += f" {line.strip()}"
    return "\n".join(head).strip(), sections[1:]


def as_action(names: str, text: str) -> Action:
    """Make what argparse prints of a flag, or of an input."""
    names = names.replace("{None}|", "")
    flags = [word.partition(" ") for word in names.split(", ") if word.startswith("-")]
    value = " ".join(rest for _, _, rest in flags if rest) or ("" if flags else names)
    several = re.fullmatch(r"\{?\[(\S+) \[.*\]\]\}?", value)
    return Action(
        [flag for flag, _, _ in flags],
        "",
        nargs="*" if several else None if value else 0,
        metavar=(several[1] if several else value.strip("{[]}") if " " in value else value) or None,
        help=NO_DEFAULT.sub("", text.strip()).replace("%", "%%"),
    )


def ordered(sections: list[Section]) -> Iterator[Section]:
    """Move flags that must be given to the front, and those that many commands share to the end."""
    shared = Section(SHARED_TITLE)
    simulates = any(entry[0].startswith("--rows ") for part in sections for entry in part.entries)
    for section in sections:
        mine = [
            entry
            for entry in section.entries
            if not simulates or re.split("[ ,]", entry[0][2:])[0] not in SHARED
        ]
        shared.entries += [entry for entry in section.entries if entry not in mine]
        mine.sort(key=lambda entry: not entry[1].endswith("(required)"))
        yield Section(section.title, mine)
    yield shared


def usual_help(printed: str) -> str:
    """Set the help of tyro in the style of argparse."""
    program = printed.removeprefix("usage: ").partition(" [")[0].partition(" PATH")[0]
    spec = getattr(sys.modules["__main__"], "__spec__", None)
    if spec is not None and program.endswith(".py"):
        program = f"python -m {spec.name.removesuffix('.__main__')}"
    elif program.endswith(".py"):
        program = f"python {Path(program).name}"
    description, sections = sections_of(printed)
    formatter = HelpFormatter(program)
    formatter.add_usage("%(prog)s [options]", [], [])
    formatter.add_text(description)
    for section in ordered(sections):
        formatter.start_section(section.title)
        formatter.add_arguments(as_action(*entry) for entry in section.entries)
        formatter.end_section()
    return formatter.format_help()
