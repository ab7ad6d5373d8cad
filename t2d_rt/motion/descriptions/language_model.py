"""Descriptions by a language model behind an OpenAI-compatible endpoint, a local one too (extra [text]).

What they are to say is drawn as the grammar draws it (Text2Doppler, Table I); what the model wrote is checked row by row
against the slots and by the parser. The package openai is loaded when a model is asked (openai_client).
"""

from __future__ import annotations

import hashlib
import json
import math
import os
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Any, Literal
from urllib.parse import urlsplit

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, create_model
from pydantic.json_schema import GenerateJsonSchema

from t2d_rt.core import disk_cache
from t2d_rt.core.checks import choice, instance, integer, positive, shown, text
from t2d_rt.core.errors import InputError, install
from t2d_rt.motion.descriptions import slots
from t2d_rt.motion.descriptions.diversity import Gathered
from t2d_rt.motion.descriptions.grammar import MOST_DESCRIPTIONS, Drawn, draw_properties, sampler_of
from t2d_rt.motion.descriptions.parse import parse_description
from t2d_rt.motion.descriptions.slots import ACTIVITIES, Activity, Description

if TYPE_CHECKING:
    from t2d_rt.motion.descriptions.openai_client import Session

KEY_VARIABLES = "T2D_API_KEY", "OPENAI_API_KEY"
"""Variables of the environment that may hold the key, the first one first."""
URL_VARIABLE = "OPENAI_BASE_URL"
DEFAULT_URL = "https://api.openai.com/v1"

BATCH = 10
"""Descriptions asked for in one request."""
MOST_FAILURES = 4
"""Replies in a row that bring nothing (no JSON, empty, refused, nothing new) before the model is given up."""
REQUESTS_PER_BATCH = 6
"""Requests allowed for each batch that is wanted, where no budget is given: no endless run."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LanguageModel:
    """A language model behind an OpenAI-compatible endpoint."""

    model: str
    base_url: str | None = None
    """Address of the endpoint, as http://localhost:8000/v1; OPENAI_BASE_URL or OpenAI's own where it is not given."""
    timeout_s: float = 60.0
    """Longest time that a reply may take [s]."""
    tries: int = 5
    """How often a request is sent when the server is busy, too slow or failing; pauses grow, or are as long as the server asks."""

    def __post_init__(self) -> None:
        if not text("model", self.model).strip():
            raise InputError(
                "model must name a language model, got an empty text; give the name that the endpoint knows"
            )
        positive("timeout_s", self.timeout_s, 3600, unit="s")
        integer("tries", self.tries, 1, 20)
        if self.base_url is not None:
            text("base_url", self.base_url)
        _check_url(self.url)

    @property
    def url(self) -> str:
        """The address that requests go to."""
        return self.base_url or os.environ.get(URL_VARIABLE) or DEFAULT_URL

    @property
    def host(self) -> str:
        """The endpoint in a sentence."""
        return urlsplit(self.url).netloc


@dataclass(frozen=True, slots=True, kw_only=True)
class TokenBudget:
    """The most that may be spent; None is no limit."""

    requests: int | None = None
    tokens: int | None = None

    def __post_init__(self) -> None:
        for name in ("requests", "tokens"):
            if getattr(self, name) is not None:
                integer(f"budget of {name}", getattr(self, name), 1)


class Stopped(Exception):
    """No further reply can be had; its text is the reason, as the end of a sentence."""


@dataclass(frozen=True, slots=True)
class Reply:
    """What the model answered: a text, or that it refuses."""

    content: str
    refusal: str = ""
    cut: bool = False
    """Whether the server ended it before it was complete."""


def _check_url(url: str) -> None:
    """Refuses what is no address of an endpoint; a key in it is not repeated."""
    try:
        parts = urlsplit(url)
        sound = parts.scheme in ("http", "https") and bool(parts.hostname) and parts.port != 0
    except ValueError:
        raise InputError("base_url is no address; write it as http://localhost:8000/v1") from None
    if parts.username is not None or parts.password is not None or parts.query:
        raise InputError(
            f"base_url must hold no user, key or query; set {' or '.join(KEY_VARIABLES)} in the environment instead"
        )
    if not sound:
        raise InputError(f"base_url must be an address such as http://localhost:8000/v1, got {shown(url)}")


# --- what is asked for ---


class AskedStep(BaseModel):
    """A step as structured output wants it: every key is there, null where the step does not say it, and no others."""

    model_config = ConfigDict(extra="forbid")

    action: slots.Action
    manner: slots.Manner | None
    direction: slots.Direction | None
    body_part: slots.BodyPart | None
    object: slots.Object | None
    side: slots.Side | None
    speed: slots.Speed
    type: slots.FallType | slots.GaitType | None
    count: Annotated[int | None, Field(description=f"times, 1 to {slots.MOST_TIMES}")]
    duration_s: Annotated[float | None, Field(description=f"seconds, up to {slots.LONGEST_S:g}")]
    angle_deg: Annotated[float | None, Field(description="of a turn")]


class AskedDescription(AskedStep):
    """A description as structured output wants it."""

    subject: slots.Subject
    before: list[AskedStep]
    after: list[AskedStep]
    sentence: str


class _Untitled(GenerateJsonSchema):
    """Names of fields say what their titles would repeat, and a request is paid for by its length."""

    def field_title_should_be_set(self, schema: Any) -> bool:
        return False


def json_schema(activity: Activity) -> dict[str, Any]:
    """The schema of a reply about a class."""
    types: Any = {"falling": slots.FallType | None, "abnormal_walking": slots.GaitType}.get(activity)
    actions: Any = Literal[slots.ACTIONS_OF[activity]]
    model = create_model("AskedOfClass", __base__=AskedDescription, action=(actions, ...), type=(types, ...))
    reply = create_model("Descriptions", __config__=ConfigDict(extra="forbid"), descriptions=(list[model], ...))  # type: ignore[valid-type]
    return reply.model_json_schema(schema_generator=_Untitled)


KINDS = {
    "walking": "normal walking, turning or climbing stairs",
    "abnormal_walking": "walking with a gait that is disturbed as the type says, in everyday or in clinical words",
    "running": "running",
    "falling": "falling, by the cause that the type says",
    "sitting": "sitting down, standing up or lying down",
    "bending": "bending, squatting, stretching or standing on one leg",
    "jumping": "jumping",
    "dancing": "dancing",
}
"""The classes in words."""

SYSTEM = (
    "You write descriptions of human motion for a data set. Each is one natural, grammatical English sentence of 5 to 30 words "
    "about what one person does with the body, as an observer would see it; no feelings without visible effect, no names, no "
    "place that matters. The sentence says all properties that are given for it, those of the steps before and after too, in "
    "this order of time, and nothing that contradicts them. Vary structure and vocabulary from sentence to sentence. Reply with "
    "JSON only: an object whose key descriptions holds a list of objects, one for each set of properties, each with the "
    "properties unchanged (null where none is given) and the key sentence."
)


def messages(activity: Activity, properties: Sequence[Drawn]) -> list[dict[str, str]]:
    """The prompt for a description of each set of properties."""
    rows = "\n".join(f"{number}. {json.dumps(_prompt_fields(item))}" for number, item in enumerate(properties, 1))
    task = (
        f"Class: {activity} ({KINDS[activity]}). Write {len(properties)} descriptions, one for each of these sets of "
        f"properties:\n{rows}"
    )
    schema = json.dumps(json_schema(activity))
    return [
        {"role": "system", "content": SYSTEM},
        {"role": "user", "content": f"{task}\n\nJSON schema of the reply: {schema}"},
    ]


def _prompt_fields(properties: Drawn) -> dict[str, Any]:
    fields: dict[str, Any] = {"subject": properties.subject, **properties.main.model_dump(exclude_none=True)}
    for name, steps in (("before", properties.before), ("after", properties.after)):
        if steps:
            fields[name] = [step.model_dump(exclude_none=True) for step in steps]
    return fields


# --- what comes back ---

LONGEST_REPLY = 200_000
"""Characters of a reply that are read."""


def rows_of(reply: str) -> list[Any]:
    """The list of descriptions in a reply, whatever they are; a ValueError where it is no such JSON."""
    if len(reply) > LONGEST_REPLY:
        raise ValueError(f"it is longer than {LONGEST_REPLY} characters")
    text = reply.strip()
    if text.startswith("```"):  # models like to wrap JSON so
        text = text.strip("`").removeprefix("json").strip()
    try:
        parsed = json.loads(text)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
    rows = parsed.get("descriptions") if isinstance(parsed, dict) else parsed
    if not isinstance(rows, list):
        raise ValueError("it holds no list of descriptions")
    return rows


def description_of(row: Any, activity: Activity) -> Description:
    """One description of a reply; an InputError where it is not valid, of another class, or says other than its slots."""
    if not isinstance(row, dict):
        raise InputError("a description must be a mapping")
    if row.get("class", activity) != activity:
        raise InputError("it is of another class")
    empty = {"before": (), "after": (), "speed": "normal", "subject": "person"}
    fields = {name: empty.get(name) if value is None else value for name, value in row.items() if name != "class"}
    for name in ("before", "after"):
        fields[name] = [_step_of(step_values) for step_values in fields.get(name) or ()]
    return Description.model_validate({**fields, "class": activity})


def _step_of(row: Any) -> Any:
    if not isinstance(row, dict):
        return row
    return {name: value for name, value in row.items() if value is not None}


def agrees(description: Description) -> bool | None:
    """Whether the sentence says what the slots say, as far as the parser understands it; None where it does not."""
    try:
        parsed = parse_description(description.sentence).description
    except InputError:
        return None
    if parsed.activity != description.activity or parsed.action != description.action:
        return False
    compared_slots = ("type", "direction")
    return all(getattr(parsed, slot) in (None, getattr(description, slot)) for slot in compared_slots)


# --- replies that are kept on disk: the same request is not paid for twice ---


def _name_of(**request: Any) -> str:
    """The name of a request: the hash of all that its reply follows from."""
    return hashlib.sha256(json.dumps(request, sort_keys=True).encode()).hexdigest()


def kept_reply(name: str) -> str | None:
    """The reply to a request; None where none is kept, or a damaged one."""
    cached = disk_cache.read(name, ["reply"])
    try:
        return None if cached is None else cached["reply"].tobytes().decode()
    except ValueError:
        return None


def keep_reply(name: str, reply: str) -> None:
    """Keeps a reply, if the disk allows it."""
    disk_cache.write(name, {"reply": np.frombuffer(reply.encode(), dtype=np.uint8)})


# --- a run ---


@dataclass(frozen=True, slots=True)
class Written:
    """Descriptions of a language model, and what became of its replies."""

    descriptions: tuple[Description, ...]
    wanted: int
    requests: int = 0
    tokens: int = 0
    cached: int = 0
    """Replies that were on disk already."""
    malformed: int = 0
    """Replies that were empty, cut short or no JSON of descriptions."""
    refusals: int = 0
    invalid: int = 0
    """Descriptions that do not fit the schema."""
    disagreeing: int = 0
    """Descriptions whose sentence says other than their slots."""
    unchecked: int = 0
    """Descriptions whose sentence the parser does not understand; they are kept."""
    near_duplicates: int = 0
    stopped: str = ""
    """Why there are fewer than wanted; empty where there are not."""

    def __str__(self) -> str:
        left_out = {
            "unusable replies": self.malformed,
            "refusals": self.refusals,
            "invalid descriptions": self.invalid,
            "whose sentence contradicts its slots": self.disagreeing,
            "near-duplicates": self.near_duplicates,
        }
        dropped = ", ".join(f"{count} {what}" for what, count in left_out.items() if count)
        return (
            f"{len(self.descriptions)} of {self.wanted} descriptions from {self.requests} requests ({self.tokens} tokens) "
            f"and {self.cached} cached replies; left out: {dropped or 'nothing'}; {self.unchecked} sentences could not be "
            "checked against their slots"
        )


@dataclass(slots=True)
class _Run:
    """What has been made so far."""

    activity: Activity
    session: Session
    seed: int
    gathered: Gathered = field(default_factory=Gathered)
    counts: Counter[str] = field(default_factory=Counter)
    """How many replies or descriptions went each of the ways that `Written` tells."""
    failures: int = 0
    last_failure: str = ""

    def batch(self, number: int, prompt: list[dict[str, str]]) -> None:
        """Asks for one batch, again with another seed where the reply cannot be used."""
        schema = json_schema(self.activity)
        model = self.session.model
        for attempt in range(MOST_FAILURES):
            seed = (self.seed * 1_000_003 + number * 101 + attempt) % 2**31
            name = _name_of(model=model.model, url=model.url, messages=prompt, schema=schema, seed=seed)
            cached_reply = kept_reply(name)
            if cached_reply is not None:
                self.counts["cached"] += 1
            reply = Reply(cached_reply) if cached_reply is not None else self.session.ask(prompt, schema, seed=seed)
            if self._take(reply):
                if cached_reply is None:
                    keep_reply(name, reply.content)
                self.failures = 0
                return
            self.failures += 1
            if self.failures >= MOST_FAILURES:
                raise Stopped(f"{MOST_FAILURES} replies in a row could not be used: {self.last_failure}")

    def _take(self, reply: Reply) -> bool:
        """Takes what is valid and new in a reply; whether there was anything."""
        if reply.refusal:
            self.counts["refusals"] += 1
            self.last_failure = f"the model refused ({shown(reply.refusal)})"
            return False
        try:
            if not reply.content.strip():
                raise ValueError("it is empty")
            rows = rows_of(reply.content)
        except ValueError as error:
            self.counts["malformed"] += 1
            self.last_failure = (
                "the reply was cut short" if reply.cut else f"the reply is no JSON as asked for ({shown(str(error))})"
            )
            return False
        before = len(self.gathered)
        for row in rows:
            self._take_row(row)
        if len(self.gathered) == before:
            self.last_failure = "nothing in the reply was valid and new"
        return len(self.gathered) > before

    def _take_row(self, row: object) -> None:
        try:
            description = description_of(row, self.activity)
        except InputError:
            self.counts["invalid"] += 1
            return
        agreed = agrees(description)
        if agreed is False:
            self.counts["disagreeing"] += 1
        elif self.gathered.add(description) and agreed is None:
            self.counts["unchecked"] += 1


def model_descriptions(
    activity: Activity,
    count: int,
    *,
    model: LanguageModel,
    seed: int = 0,
    budget: TokenBudget | None = None,
    progress: Callable[[float], None] | None = None,
) -> Written:
    """`count` different descriptions of a class by a language model, or as many as could be had and why there are no more.

    activity: one of the eight classes.
    count: how many descriptions.
    model: the model and its endpoint; the key comes from T2D_API_KEY or OPENAI_API_KEY.
    seed: seed of the properties that are asked for; the same requests are answered from the cache on disk.
    budget: the most requests and tokens that may be spent; where none is given, 6 requests for every 10 descriptions.
    progress: called with the fraction done.
    """
    try:
        from t2d_rt.motion.descriptions.openai_client import Session
    except ImportError:
        raise InputError(
            f"descriptions by a language model need the package openai, which is not installed; {install('text')}"
        ) from None
    choice("activity", activity, ACTIVITIES)
    count = integer("count", count, 1, MOST_DESCRIPTIONS)
    instance("model", model, LanguageModel, "a LanguageModel")
    budget = instance("budget", budget or TokenBudget(), TokenBudget, "a TokenBudget")
    if budget.requests is None and budget.tokens is None:
        budget = TokenBudget(requests=REQUESTS_PER_BATCH * math.ceil(count / BATCH))
    sampler = sampler_of(activity, seed)
    run = _Run(activity, Session(model, budget), seed)
    stopped = ""
    number = 0
    try:
        while len(run.gathered) < count:
            run.batch(number, messages(activity, [draw_properties(activity, sampler) for _ in range(BATCH)]))
            number += 1
            if progress is not None:
                progress(min(len(run.gathered) / count, 1.0))
    except Stopped as reason:
        stopped = str(reason)
    finally:
        run.session.close()
    if not run.gathered.descriptions:
        raise InputError(f"no description was made: {stopped}")
    session = run.session
    descriptions = tuple(run.gathered.descriptions[:count])
    spent = {"requests": session.requests, "tokens": session.tokens, "near_duplicates": run.gathered.refused}
    return Written(descriptions, count, **spent, **run.counts, stopped=stopped)
