"""The JSON Schema of the events, and their types for TypeScript, from `receiver.events`."""

from types import NoneType, UnionType
from typing import Annotated, Any, Literal, NotRequired, Union, get_args, get_origin, get_type_hints

from receiver.events import Event, FilmEvent

NAMES = {str: "string", int: "integer", float: "number", bool: "boolean", NoneType: "null"}
"""Names of the types of JSON Schema, by those of Python."""


def events_schema() -> dict[str, Any]:
    """Describe one event, a line of what `receiver` prints, as JSON Schema (2020-12)."""
    kinds = get_args(Event)
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Event",
        "description": "What the receiver says, one JSON object a line. Keys may be added.",
        "anyOf": [{"$ref": f"#/$defs/{kind.__name__}"} for kind in kinds],
        "$defs": {kind.__name__: _schema_of_event(kind) for kind in kinds},
    }


def _schema_of_event(kind: type) -> dict[str, Any]:
    """Describe a `TypedDict`."""
    fields = get_type_hints(kind, include_extras=True)
    return {
        "type": "object",
        "description": kind.__doc__,
        "properties": {name: schema_of(field) for name, field in fields.items()},
        "required": [name for name, field in fields.items() if get_origin(field) != NotRequired],
    }


def schema_of(field: Any) -> dict[str, Any]:
    """Describe a type that a field of an event has.

    >>> schema_of(Annotated[list[int] | None, "in order"])
    {'type': ['array', 'null'], 'items': {'type': 'integer'}, 'description': 'in order'}
    """
    of, args = get_origin(field), get_args(field)
    if of is NotRequired:
        return schema_of(args[0])
    if of is Annotated:
        return {**schema_of(args[0]), "description": args[1]}
    if of in (Union, UnionType):  # of a type and None
        some = schema_of(args[0])
        return {**some, "type": [some["type"], "null"]}
    if of is Literal:
        return {"const": args[0]}
    if of is list:
        return {"type": "array", "items": schema_of(args[0])}
    if of is dict:
        return {"type": "object", "additionalProperties": schema_of(args[1])}
    return {"type": NAMES[field]}


def events_types() -> str:
    """Write the events' types for TypeScript, from their JSON Schema."""
    schema = events_schema()
    parts = ["/** Written by web/package/schema.py; change receiver/events.py. */"]
    for name, kind in schema["$defs"].items():
        parts += ["", f"/** {kind['description']} */", f"export interface {name} {{"]
        for key, field in kind["properties"].items():
            optional = "" if key in kind["required"] else "?"
            if "description" in field:
                parts.append(f"  /** {field['description']} */")
            parts.append(f"  {key}{optional}: {typescript_of(field)};")
        parts.append("}")
    for name, union in (("FilmEvent", FilmEvent), ("Event", Event)):
        kinds = " | ".join(kind.__name__ for kind in get_args(union))
        parts += ["", f"export type {name} = {kinds};"]
    return "\n".join([*parts, ""])


def typescript_of(schema: dict[str, Any]) -> str:
    """Name the type of a field in TypeScript.

    >>> typescript_of(schema_of(list[list[float]] | None))
    'number[][] | null'
    """
    if "const" in schema:
        return "true" if schema["const"] is True else f'"{schema["const"]}"'
    kinds = schema["type"] if isinstance(schema["type"], list) else [schema["type"]]
    names = {
        "integer": "number",
        "array": f"{typescript_of(schema['items'])}[]" if "items" in schema else "",
        "object": "Record<string, number>",
    }
    return " | ".join(str(names.get(kind, kind)) for kind in kinds)
