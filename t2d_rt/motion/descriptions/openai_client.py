"""Requests to an OpenAI-compatible endpoint by the package openai, within a budget, a time and a size.

The package counts tries and waits between them. Three things it does not give, and this module adds: a limit of requests over all
tries, a limit of the whole time of an answer (its own timeout is that of one piece, and a server may send one byte after the other)
and a limit of an answer's size. Redirections are not followed: they would hand the key and the sentences to whom they name.

The key comes from the environment only (T2D_API_KEY, or OPENAI_API_KEY). It is held by the client and stands in no value, error,
log or file of this package.
"""

from __future__ import annotations

import os
import re
import sys
import threading
from collections.abc import Mapping, Sequence
from typing import Any

import openai

from t2d_rt.core.checks import shown
from t2d_rt.core.errors import InputError
from t2d_rt.motion.descriptions.language_model import (
    DEFAULT_URL,
    KEY_VARIABLES,
    LanguageModel,
    Reply,
    Stopped,
    TokenBudget,
)

MOST_BYTES = 8_000_000
"""Most bytes of an unpacked answer: a batch of descriptions has some ten thousand."""
LONGEST_TOLD = 200
"""Characters of a server's own message in a sentence."""
CHARACTERS_PER_TOKEN = 4
"""About what English text has; used where a server does not count tokens."""

Message = Mapping[str, str]


class Session:
    """A client with what it has spent."""

    def __init__(self, model: LanguageModel, budget: TokenBudget) -> None:
        self.model, self.budget = model, budget
        self.requests = self.tokens = self._size = 0
        self.formats = ["json_schema", "json_object", "text"]
        """Ways to ask for JSON, the best first; those that the server does not know are taken out."""
        self._client = openai.OpenAI(
            api_key=api_key(model) or "none",
            base_url=model.url,
            timeout=model.timeout_s,
            max_retries=model.tries - 1,
            http_client=BoundedClient(self),
        )

    def ask(self, messages: Sequence[Message], schema: Mapping[str, Any], *, seed: int) -> Reply:
        """One reply, tried again while the server is busy or failing."""
        self._size = sum(len(message["content"]) for message in messages)
        while True:
            before = self.requests
            try:
                return self._reply(messages, schema, seed)
            except (openai.BadRequestError, openai.UnprocessableEntityError) as error:
                if len(self.formats) == 1 or "context" in str(error).lower():
                    raise Stopped(self._explanation(error)) from None
                del self.formats[0]
            except openai.APIError as error:
                if isinstance(error.__cause__, Stopped):  # earlier versions of the package wrap what a request raises
                    raise error.__cause__ from None
                tries = self.requests - before
                raise Stopped(self._explanation(error) + (f" ({tries} tries)" if tries > 1 else "")) from None

    def _reply(self, messages: Sequence[Message], schema: Mapping[str, Any], seed: int) -> Reply:
        response_format: dict[str, Any] = {"type": self.formats[0]}
        if self.formats[0] == "json_schema":
            response_format["json_schema"] = {"name": "descriptions", "strict": True, "schema": schema}
        completion = None
        try:
            completion = self._client.chat.completions.create(
                model=self.model.model, messages=list(messages), response_format=response_format, seed=seed
            )
            choice = completion.choices[0]
            content, refusal = choice.message.content or "", getattr(choice.message, "refusal", None) or ""
            reason = choice.finish_reason
        except (AttributeError, LookupError, TypeError, ValueError, RecursionError):  # it is no completion, or no JSON
            content, refusal, reason = "", "", "stop"
        content, refusal = (self._without_key(str(value)) for value in (content, refusal))
        used = getattr(getattr(completion, "usage", None), "total_tokens", None)
        estimated = (self._size + len(content)) // CHARACTERS_PER_TOKEN
        self.tokens += used if isinstance(used, int) and used > 0 else estimated
        if reason == "content_filter":
            refusal = refusal or "its content filter"
        return Reply(content, refusal, cut=reason == "length")

    def spend_request(self) -> None:
        """Counts a request, or stops where it would go beyond the budget."""
        most = self.budget.requests
        if most is not None and self.requests >= most:
            raise Stopped(f"the budget of {most} requests is used up")
        most = self.budget.tokens
        next_one = self.tokens / self.requests if self.requests else 2 * self._size / CHARACTERS_PER_TOKEN
        if most is not None and self.tokens + next_one > most:
            raise Stopped(
                f"the budget of {most} tokens is used up ({self.tokens} spent, a request takes about {next_one:.0f})"
            )
        self.requests += 1

    def close(self) -> None:
        """Ends the connection to the endpoint."""
        self._client.close()

    def _explanation(self, error: Any) -> str:
        """What went wrong, in plain words and without the key."""
        if isinstance(error, openai.APITimeoutError):
            return f"{self.model.host} did not answer within {self.model.timeout_s:g} s"
        if isinstance(error, openai.APIConnectionError):
            return f"{self.model.host} cannot be reached; check --base-url and whether the server runs"
        status = getattr(error, "status_code", None)
        body = getattr(error, "body", None)
        message = body.get("message") if isinstance(body, dict) else None
        message = self._without_key(" ".join(str(message or getattr(error, "message", error)).split()))[:LONGEST_TOLD]
        if status in (401, 403):
            return f"{self.model.host} refuses the key (status {status}); set {' or '.join(KEY_VARIABLES)}"
        if status is not None and 300 <= status < 400:
            return f"{self.model.host} sends requests on to another address (status {status}); give that one with --base-url"
        if status == 404:
            return f"{self.model.host} knows no model {shown(self.model.model)} at this address (status 404)"
        wait = error.response.headers.get("retry-after", "") if isinstance(error, openai.APIStatusError) else ""
        if re.fullmatch(r"\d+(\.\d+)?", wait):
            return f"{self.model.host} asks to wait {float(wait):.0f} s; try again later"
        return f"{self.model.host} answers with an error (status {status}): {message}"

    def _without_key(self, words: str) -> str:
        key = api_key(self.model)
        return words.replace(key, "(key)") if key else words


class BoundedClient(openai.DefaultHttpxClient):  # type: ignore[misc]
    """Sends what the budget of a session allows, and reads an answer within the model's time and `MOST_BYTES`."""

    def __init__(self, session: Session) -> None:
        super().__init__(follow_redirects=False)
        self._asked_by = session

    def send(self, request: Any, **options: Any) -> Any:
        """The answer to a request, read to its end; a timeout that is tried again where that takes longer than it may."""
        self._asked_by.spend_request()
        ended: list[Any] = []

        def run() -> None:
            try:
                ended.append(self._read(request, {**options, "stream": True}))
            except BaseException as error:
                ended.append(error)

        thread = threading.Thread(target=run, name="request to a language model", daemon=True)
        thread.start()
        thread.join(self._asked_by.model.timeout_s)
        if not ended:
            library = sys.modules[
                type(request).__module__.partition(".")[0]
            ]  # httpx, or the successor that openai uses
            raise library.ReadTimeout("the answer does not end", request=request)
        if isinstance(ended[0], BaseException):
            raise ended[0]
        return ended[0]

    def _read(self, request: Any, options: dict[str, Any]) -> Any:
        response = super().send(request, **options)
        parts, size = [], 0
        for part in response.iter_bytes():
            parts.append(part)
            size += len(part)
            if size > MOST_BYTES:
                response.close()
                host = self._asked_by.model.host
                raise Stopped(f"{host} answers with more than {MOST_BYTES // 10**6} MB; check --base-url")
        response._content = b"".join(parts)
        if b"insufficient_quota" in response._content:  # no later try would be answered
            response.headers["x-should-retry"] = "false"
        return response


def api_key(model: LanguageModel) -> str | None:
    """The key of the environment; None where there is none, which only other endpoints than OpenAI's own allow."""
    key = next((os.environ[name].strip() for name in KEY_VARIABLES if os.environ.get(name, "").strip()), None)
    if key is None and model.url == DEFAULT_URL:
        raise InputError(
            f"{model.host} needs a key; set {' or '.join(KEY_VARIABLES)} in the environment, or give the address of another "
            "endpoint (--base-url)"
        )
    if key is not None and not (key.isascii() and key.isprintable()):
        raise InputError(f"the key in {' or '.join(KEY_VARIABLES)} holds characters that no key has; set it again")
    return key
