"""Every number of a camera-display pair has a range, and what lies outside is refused by name."""

import math
from collections.abc import Iterator
from dataclasses import fields, is_dataclass, replace
from typing import Annotated, Any, NamedTuple, get_args, get_origin, get_type_hints

import pytest
from hypothesis import given
from hypothesis import strategies as st

from data_gen.pairs import PAIRS
from data_gen.parameters import IDENTITY, RGB, Limits, Matrix, Nuisance, Pair
from link.errors import InputError

PAIR = PAIRS["canon-samsung"]


class Ranged(NamedTuple):
    part: Any
    field: str
    kind: Any
    limits: Limits


def parts(part: Any) -> Iterator[Any]:
    """A pair and the dataclasses in it."""
    yield part
    for entry in fields(part):
        if is_dataclass(value := getattr(part, entry.name)):
            yield from parts(value)


def annotations(part: Any) -> Iterator[tuple[str, Any, Limits | None]]:
    """Each field's name, kind and range: the one place that knows how ranges are declared."""
    for field, hint in get_type_hints(type(part), include_extras=True).items():
        if get_origin(hint) is Annotated:
            kind, limits = get_args(hint)
            yield field, kind, limits
        else:
            yield field, hint, None


RANGED = [
    Ranged(part, field, kind, limits)
    for part in parts(PAIR)
    for field, kind, limits in annotations(part)
    if limits is not None
]
each_range = pytest.mark.parametrize(
    "ranged", RANGED, ids=[f"{type(r.part).__name__}.{r.field}" for r in RANGED]
)


def with_number(value: Any, number: float) -> Any:
    """The value with its last number replaced, however deep it lies."""
    if not isinstance(value, tuple):
        return number
    return (*value[:-1], with_number(value[-1], number))


def changed(ranged: Ranged, value: Any) -> Any:
    return replace(ranged.part, **{ranged.field: value})


def refused(ranged: Ranged, value: Any) -> bool:
    """Whether the value is refused by the names of the part and of the field."""
    with pytest.raises(InputError) as error:
        changed(ranged, value)
    return str(error.value).startswith(f"{ranged.part.name}: {ranged.field} must ")


def test_every_number_has_a_range() -> None:
    without = {
        field
        for part in parts(PAIR)
        for field, kind, limits in annotations(part)
        if limits is None and kind in (int, float, RGB, Matrix)
    }
    assert without == set()
    assert len(RANGED) > 30
    assert all(math.isfinite(r.limits.low) and r.limits.low < r.limits.high for r in RANGED)


@each_range
def test_a_value_just_outside_the_range_is_refused_by_name(ranged: Ranged) -> None:
    low, high = ranged.limits.low, ranged.limits.high
    outside = math.nextafter(low, -math.inf), math.nextafter(high, math.inf)
    for value in (low - 1, high + 1) if ranged.kind is int else outside:
        assert refused(ranged, with_number(getattr(ranged.part, ranged.field), value))


@each_range
@pytest.mark.parametrize("number", [math.nan, -math.inf])
def test_what_is_no_finite_number_is_refused_by_name(ranged: Ranged, number: float) -> None:
    assert refused(ranged, with_number(getattr(ranged.part, ranged.field), number))


@pytest.mark.parametrize("end", ["low", "high"])
@each_range
def test_both_ends_of_a_range_belong_to_it(ranged: Ranged, end: str) -> None:
    if ranged.kind == Matrix:  # rows must sum to 1 as well
        assert changed(ranged, IDENTITY)
        return
    value = with_number(getattr(ranged.part, ranged.field), getattr(ranged.limits, end))
    assert getattr(changed(ranged, value), ranged.field) == value


@pytest.mark.parametrize("length", [2, 4])
@pytest.mark.parametrize("field", [r.field for r in RANGED if r.kind == RGB])
def test_a_colour_of_other_than_three_numbers_is_refused(field: str, length: int) -> None:
    ranged = next(r for r in RANGED if r.field == field)
    assert refused(ranged, (2.0,) * length)


# Nuisances by view


def two_views(frontal: float, oblique: float) -> Pair:
    ends = [Nuisance("any", drift, 0.1, 0.5) for drift in (frontal, oblique)]
    return replace(PAIR, frontal=ends[0], oblique=ends[1])


@given(st.floats(0, 0.5), st.floats(0, 0.5), st.floats(-75, 75))
def test_nuisances_are_linear_up_to_45_degrees_and_held_beyond(
    frontal: float, oblique: float, view: float
) -> None:
    share = min(1.0, abs(view) / 45)
    drift = two_views(frontal, oblique).nuisance(view).drift
    assert drift == pytest.approx(frontal + share * (oblique - frontal), abs=1e-12)
    assert min(frontal, oblique) - 1e-12 <= drift <= max(frontal, oblique) + 1e-12


@given(st.floats(0, 45))
def test_nuisances_at_the_end_of_their_range_hold_at_every_view(view: float) -> None:
    highest = Nuisance("any", 0.5, 5.0, 10.0)
    found = replace(PAIR, frontal=highest, oblique=highest).nuisance(view)
    assert (found.drift, found.jitter_px, found.noise_scale) == pytest.approx((0.5, 5.0, 10.0))
