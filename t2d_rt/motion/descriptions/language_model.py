"""Descriptions written by a language model, with properties drawn as the grammar draws them (Text2Doppler, Table I)."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from t2d_rt.core.checks import choice, instance, integer, shown
from t2d_rt.core.errors import InputError
from t2d_rt.motion.descriptions import replies
from t2d_rt.motion.descriptions.diversity import Gathered
from t2d_rt.motion.descriptions.endpoint import Budget, LanguageModel, Reply, Session, Stopped, check_installed
from t2d_rt.motion.descriptions.grammar import MOST_DESCRIPTIONS, dealer_of, drawn
from t2d_rt.motion.descriptions.schema import agrees, description_of, json_schema, messages, rows_of
from t2d_rt.motion.descriptions.slots import ACTIVITIES, Activity, Description

BATCH = 10
"""Descriptions asked for in one request."""
MOST_FAILURES = 4
"""Replies in a row that bring nothing (no JSON, empty, refused, nothing new) before the model is given up."""
REQUESTS_PER_BATCH = 6
"""Requests allowed for each batch that is wanted, where no budget is given: no endless run."""


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
        dropped = ", ".join(
            f"{count} {what}"
            for count, what in (
                (self.malformed, "unusable replies"), (self.refusals, "refusals"), (self.invalid, "invalid descriptions"),
                (self.disagreeing, "whose sentence contradicts its slots"), (self.near_duplicates, "near-duplicates"),
            )
            if count
        )  # fmt: skip
        return (
            f"{len(self.descriptions)} of {self.wanted} descriptions from {self.requests} requests ({self.tokens} "
            "tokens) and "
            f"{self.cached} cached replies; left out: {dropped or 'nothing'}; {self.unchecked} sentences could not be "
            "checked against their slots"
        )


@dataclass(slots=True)
class _Run:
    """What has been made so far."""

    activity: Activity
    session: Session
    seed: int
    gathered: Gathered = field(default_factory=Gathered)
    counts: dict[str, int] = field(default_factory=lambda: dict.fromkeys(
        ("cached", "malformed", "refusals", "invalid", "disagreeing", "unchecked"), 0
    ))  # fmt: skip
    failures: int = 0
    last_failure: str = ""

    def batch(self, number: int, prompt: list[dict[str, str]]) -> None:
        """Asks for one batch, again with another seed where the reply cannot be used."""
        schema = json_schema(self.activity)
        model = self.session.model
        for attempt in range(MOST_FAILURES):
            seed = (self.seed * 1_000_003 + number * 101 + attempt) % 2**31
            name = replies.name_of(model=model.model, url=model.url, messages=prompt, schema=schema, seed=seed)
            kept = replies.read(name)
            if kept is not None:
                self.counts["cached"] += 1
            reply = Reply(kept) if kept is not None else self.session.ask(prompt, schema, seed=seed)
            if self._take(reply):
                if kept is None:
                    replies.write(name, reply.content)
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
    budget: Budget | None = None,
    progress: Callable[[float], None] | None = None,
    sleep: Callable[[float], None] = time.sleep,
) -> Written:
    """`count` different descriptions of a class by a language model, or as many as could be had and why there are no more.

    activity: one of the eight classes.
    count: how many descriptions.
    model: the model and its endpoint; the key comes from T2D_API_KEY or OPENAI_API_KEY.
    seed: seed of the properties that are asked for; the same requests are answered from the cache on disk.
    budget: the most requests and tokens that may be spent; where none is given, 6 requests for every 10 descriptions.
    progress: called with the fraction done.
    sleep: waits before a further try [s].
    """
    check_installed()
    choice("activity", activity, ACTIVITIES)
    count = integer("count", count, 1, MOST_DESCRIPTIONS)
    instance("model", model, LanguageModel, "a LanguageModel")
    budget = instance("budget", budget or Budget(), Budget, "a Budget")
    if budget.requests is None and budget.tokens is None:
        budget = Budget(requests=REQUESTS_PER_BATCH * math.ceil(count / BATCH))
    dealer = dealer_of(activity, seed)
    run = _Run(activity, Session(model, budget, sleep), seed)
    stopped = ""
    number = 0
    try:
        while len(run.gathered) < count:
            run.batch(number, messages(activity, [drawn(activity, dealer) for _ in range(BATCH)]))
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
    return Written(
        tuple(run.gathered.descriptions[:count]), count, session.requests, session.tokens, **run.counts,
        near_duplicates=run.gathered.refused, stopped=stopped,
    )  # fmt: skip
