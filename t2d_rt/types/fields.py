"""Base of the models that people write as YAML: kinds of numbers, and errors in one sentence."""

from __future__ import annotations

import difflib
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from t2d_rt.core.calls import public
from t2d_rt.core.checks import names_advice, shown
from t2d_rt.core.errors import InputError


def _not_bool(value: Any) -> Any:
    # YAML reads `yes` and `on` as true, which pydantic would take for 1.
    if isinstance(value, bool):
        raise ValueError("a number is expected")
    return value


def _triples(value: Any) -> Any:
    """Accepts a single position x, y, z as a list of one position."""
    if isinstance(value, (list, tuple)) and len(value) == 3 and not any(isinstance(x, (list, tuple)) for x in value):
        return (value,)
    return value


# The limits catch values in a wrong unit (77 for 77 GHz, 46.4 for MHz/us) and keep every derived figure finite.
Number = Annotated[float, BeforeValidator(_not_bool), Field(allow_inf_nan=False)]
Decibel = Annotated[Number, Field(ge=-200, le=200)]
Coordinate = Annotated[Number, Field(ge=-1e6, le=1e6)]
Vector = tuple[Coordinate, Coordinate, Coordinate]
Vectors = Annotated[tuple[Vector, ...], BeforeValidator(_triples), Field(min_length=1, max_length=1024)]
Count = Annotated[int, BeforeValidator(_not_bool)]


def later(default: Any) -> Any:
    """Default of a field that earlier versions did not have. The default is not written, so that files and hashes stay as they
    were."""
    return Field(default, exclude_if=lambda value: value == default)


@public
class Fields(BaseModel):
    """A frozen model of named fields; what is wrong with them comes as an InputError of one sentence."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    noun: ClassVar[str] = "radar"
    """Noun by which error messages call the model."""
    if_missing: ClassVar[str] = "give it"
    """What an error message says to do about a missing field."""
    written: ClassVar[Mapping[str, str]] = {}
    """How to write fields that are lists or mappings, for error messages."""

    def __init__(self, **values: Any) -> None:
        try:
            super().__init__(**values)
        except ValidationError as error:
            raise InputError(_sentence(error, type(self))) from None

    @classmethod
    def from_options(cls, **values: Any) -> Self:
        """A model from the options of a function; error messages name the option alone."""
        try:
            return cls(**values)
        except InputError as error:
            if not isinstance(error.__context__, ValidationError):
                raise
            raise InputError(_sentence(error.__context__, cls, options=True)) from None

    @classmethod
    def of_file(cls, path: str | Path, values: Mapping[str, Any]) -> Self:
        """A model from the content of a file; an InputError names the file."""
        try:
            return cls.model_validate(values)
        except InputError as error:
            raise InputError(f"{path}: {error}") from None

    def yaml_text(self) -> str:
        """All fields as YAML text, from which an equal model can be read."""
        import yaml

        return str(yaml.safe_dump(self.model_dump(mode="json"), sort_keys=False))

    @classmethod
    def model_validate(cls, obj: Any, **options: Any) -> Self:
        """A model from a mapping of field names and values; raises an InputError where it is wrong."""
        if isinstance(obj, Mapping) and not all(isinstance(key, str) for key in obj):
            raise InputError(
                f"{_article(cls)} must be a mapping of field names and values, got keys {shown(list(obj))}"
            )
        try:
            return super().model_validate(obj, **options)
        except ValidationError as error:
            raise InputError(_sentence(error, cls)) from None

    @classmethod
    def model_validate_json(cls, json_data: str | bytes | bytearray, **options: Any) -> Self:
        """A model from a JSON object of field names and values; raises an InputError where it is wrong or gives a key twice."""
        try:
            values = json.loads(json_data, object_pairs_hook=_each_once)
        except (TypeError, ValueError, RecursionError) as error:  # UnicodeDecodeError is a ValueError, too
            reason = "is nested too deeply" if isinstance(error, RecursionError) else str(error)
            raise InputError(f"the JSON text of {_article(cls)} cannot be read: {reason}; correct it") from None
        return cls.model_validate(values, **options)


def _each_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """The members of a JSON object as a dictionary; raises a ValueError where a key comes twice, of which `json` would keep the
    last."""
    members = dict(pairs)
    if len(members) < len(pairs):
        twice = next(key for number, (key, _) in enumerate(pairs) if key in dict(pairs[:number]))
        raise ValueError(f"key {shown(twice)} is given twice")
    return members


def _article(model: type[Fields]) -> str:
    return f"{'an' if model.noun[0] in 'aeiou' else 'a'} {model.noun}"


def _sentence(error: ValidationError, model: type[Fields], *, options: bool = False) -> str:
    """One sentence about the first error that pydantic found."""
    # An unknown key comes before a missing one: it is mostly the missing one, misspelt.
    errors = error.errors(include_url=False)
    first = next((fault for fault in errors if fault["type"] == "extra_forbidden"), errors[0])
    others = {fault["loc"][:1] for fault in errors} - {first["loc"][:1]}
    cause = first.get("ctx", {}).get("error")
    if isinstance(cause, InputError):
        return str(cause)
    key = str(first["loc"][0]) if first["loc"] else ""
    more = f" ({len(others)} more {'fields are' if len(others) > 1 else 'field is'} wrong)" if others else ""
    value = shown(first["input"])
    if not key:
        return f"{_article(model)} must be a mapping of field names and values, got {value}"
    if first["type"] == "union_tag_invalid":
        return f"{model.noun} key {key}: {_unknown_kind(first['ctx'])}{more}"
    name = key if options else f"{model.noun} key {key}"
    if key in model.written and first["type"].endswith(("_type", "union_tag_not_found")):
        if options:
            return f"{key} must be {model.written[key]}, got {value}{more}"
        return f"{model.noun} key {key}: got {value}, write it as {model.written[key]}{more}"
    if first["type"] == "too_short" and not first["ctx"]["actual_length"]:
        return f"{name} is empty; give at least one{more}"
    if first["type"] == "extra_forbidden":
        close = difflib.get_close_matches(key, model.model_fields, n=1)
        hint = f"did you mean {close[0]}?" if close else f"valid keys are {', '.join(model.model_fields)}"
        return f"unknown {model.noun} key '{key}'; {hint}{more}"
    if first["type"] == "missing" and len(first["loc"]) == 1:
        return f"{model.noun} key {key} is missing; {model.if_missing}{more}"
    if first["type"] in ("missing", "too_long", "tuple_type") and not key.endswith(("_deg", "_db")):
        several = ", or a list of such" if key.endswith("offsets_m") else ""
        return f"{model.noun} key {key} must be three numbers x, y, z{several}, got {value}{more}"
    expected = first["msg"].removeprefix("Value error, ").removeprefix("Input ")
    if options and expected.startswith("should "):
        what = re.split(", (?:got|unable) ", expected.removeprefix("should "))[0]
        return f"{key} must {what}, got {value}{more}"
    units = ", in SI units" if key.endswith(("_m", "_s", "_hz", "_mps", "_w")) else ""
    return f"{name}: got {value}, {expected}; correct it{units}{more}"


def _unknown_kind(context: Mapping[str, Any]) -> str:
    """A sentence that the value of `kind` is unknown, with the closest known one."""
    kinds = [tag.strip().strip("'") for tag in context["expected_tags"].split(",")]
    return f"unknown kind {shown(context['tag'])}; {names_advice(context['tag'], kinds)}"
