"""Requests to an OpenAI-compatible endpoint, a local one too: retries, budget, and a key that is never said.

The key comes from the environment only (T2D_API_KEY, or OPENAI_API_KEY). It is held by the client and stands in no value,
error, log or file of this package.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import urlsplit

from t2d_rt.core.checks import integer, positive, shown, text
from t2d_rt.core.errors import InputError, install

KEY_VARIABLES = "T2D_API_KEY", "OPENAI_API_KEY"
"""Variables of the environment that may hold the key, the first one first."""
URL_VARIABLE = "OPENAI_BASE_URL"
DEFAULT_URL = "https://api.openai.com/v1"
MOST_WAIT_S = 60.0
"""A server that asks for a longer pause is not waited for [s]."""
MOST_BYTES = 8_000_000
"""Of an answer, unpacked: a batch of descriptions has some ten thousand."""
TRIES_TO_CONNECT = 3
LONGEST_TOLD = 200
"""Characters of a server's own message in a sentence."""
CHARACTERS_PER_TOKEN = 4
"""Of English text, about; used where a server does not count tokens."""

Message = Mapping[str, str]


@dataclass(frozen=True, slots=True, kw_only=True)
class LanguageModel:
    """A language model behind an OpenAI-compatible endpoint."""

    model: str
    base_url: str | None = None
    """Address of the endpoint, as http://localhost:8000/v1; OPENAI_BASE_URL or OpenAI's own where it is not given."""
    timeout_s: float = 60.0
    """Longest time that a reply may take [s]."""
    tries: int = 5
    """How often a request is sent when the server is busy, too slow or failing."""
    backoff_s: float = 1.0
    """Pause before the second try [s]; each further one is twice as long."""

    def __post_init__(self) -> None:
        if not text("model", self.model).strip():
            raise InputError(
                "model must name a language model, got an empty text; give the name that the endpoint knows"
            )
        positive("timeout_s", self.timeout_s, 3600, unit="s")
        integer("tries", self.tries, 1, 20)
        positive("backoff_s", self.backoff_s, MOST_WAIT_S, unit="s")
        if self.base_url is not None:
            text("base_url", self.base_url)
        _check_url(self.url)

    @property
    def url(self) -> str:
        """Where requests go."""
        return self.base_url or os.environ.get(URL_VARIABLE) or DEFAULT_URL

    @property
    def host(self) -> str:
        """The endpoint in a sentence."""
        return urlsplit(self.url).netloc


@dataclass(frozen=True, slots=True, kw_only=True)
class Budget:
    """The most that may be spent; None is no limit."""

    requests: int | None = None
    tokens: int | None = None

    def __post_init__(self) -> None:
        for name in ("requests", "tokens"):
            if getattr(self, name) is not None:
                integer(f"budget of {name}", getattr(self, name), 1)


class Late(Exception):
    """An answer that takes longer than it may in all, however steadily its bytes come."""


class TooLarge(Exception):
    """An answer of more than `MOST_BYTES`."""


class Stopped(Exception):
    """No further reply can be had; its text is the reason, as the end of a sentence."""


@dataclass(frozen=True, slots=True)
class Reply:
    """What the model answered: a text, or that it refuses."""

    content: str
    refusal: str = ""
    cut: bool = False
    """Whether the server ended it before it was complete."""


@dataclass(slots=True)
class Session:
    """A client with what it has spent."""

    model: LanguageModel
    budget: Budget
    sleep: Callable[[float], None] = time.sleep
    requests: int = 0
    tokens: int = 0
    formats: list[str] = field(default_factory=lambda: ["json_schema", "json_object", "text"])
    """Ways to ask for JSON, the best first; those that the server does not know are taken out."""
    _client: Any = field(default=None, repr=False)

    def ask(self, messages: Sequence[Message], schema: Mapping[str, Any], *, seed: int) -> Reply:
        """One reply, tried again while the server is busy or failing."""
        import openai

        client = self._connected()
        size = sum(len(each["content"]) for each in messages)
        tried = 0
        while True:
            self._spend_request(size)
            tried += 1
            try:
                return within(self.model.timeout_s, lambda: self._reply(client, messages, schema, seed, size))
            except (openai.BadRequestError, openai.UnprocessableEntityError) as error:
                if len(self.formats) == 1 or "context" in str(error).lower():
                    raise Stopped(self._told(error)) from None
                del self.formats[0]
                tried -= 1
            except (openai.AuthenticationError, openai.PermissionDeniedError, openai.NotFoundError) as error:
                raise Stopped(self._told(error)) from None
            except (openai.APIError, Late, TooLarge) as error:
                self._pause(error, tried)

    def _reply(
        self, client: Any, messages: Sequence[Message], schema: Mapping[str, Any], seed: int, size: int
    ) -> Reply:
        wanted: dict[str, Any] = {"type": self.formats[0]}
        if self.formats[0] == "json_schema":
            wanted["json_schema"] = {"name": "descriptions", "strict": True, "schema": schema}
        found = None
        try:
            found = client.chat.completions.create(
                model=self.model.model, messages=list(messages), response_format=wanted, seed=seed
            )
            choice = found.choices[0]
            content, refusal = choice.message.content or "", getattr(choice.message, "refusal", None) or ""
            reason = choice.finish_reason
        except (AttributeError, LookupError, TypeError, ValueError, RecursionError):  # it is no completion, or no JSON
            content, refusal, reason = "", "", "stop"
        content, refusal = (self._without_key(str(each)) for each in (content, refusal))
        used = getattr(getattr(found, "usage", None), "total_tokens", None)
        self.tokens += used if isinstance(used, int) and used > 0 else (size + len(content)) // CHARACTERS_PER_TOKEN
        if reason == "content_filter":
            refusal = refusal or "its content filter"
        return Reply(content, refusal, cut=reason == "length")

    def _spend_request(self, size: int) -> None:
        """Counts a request, or stops where it would go beyond the budget."""
        most = self.budget.requests
        if most is not None and self.requests >= most:
            raise Stopped(f"the budget of {most} requests is used up")
        most = self.budget.tokens
        next_one = self.tokens / self.requests if self.requests else 2 * size / CHARACTERS_PER_TOKEN
        if most is not None and self.tokens + next_one > most:
            raise Stopped(
                f"the budget of {most} tokens is used up ({self.tokens} spent, a request takes about {next_one:.0f})"
            )
        self.requests += 1

    def _pause(self, error: Any, tried: int) -> None:
        """Waits before the next try, or stops where there is none."""
        import openai

        connecting = isinstance(error, openai.APIConnectionError) and not isinstance(error, openai.APITimeoutError)
        tries = min(self.model.tries, TRIES_TO_CONNECT) if connecting else self.model.tries
        if "insufficient_quota" in str(error) or 300 <= (getattr(error, "status_code", None) or 0) < 400:
            raise Stopped(self._told(error)) from None
        if tried >= tries:
            raise Stopped(f"{self._told(error)} ({tried} tries)") from None
        wait = self.model.backoff_s * 2 ** (tried - 1)
        asked = _retry_after(error)
        if asked is not None and asked > MOST_WAIT_S:
            raise Stopped(f"{self.model.host} asks to wait {asked:.0f} s; try again later") from None
        self.sleep(min(max(wait, asked or 0.0), MOST_WAIT_S))

    def _connected(self) -> Any:
        if self._client is None:
            import openai

            # Retries are counted here; the client's own would go beyond the budget unseen.
            key = api_key(self.model)
            self._client = openai.OpenAI(
                api_key=key or "none", base_url=self.model.url, timeout=self.model.timeout_s, max_retries=0,
                # Who follows a redirection hands the key and the sentences to whom it names.
                http_client=openai.DefaultHttpxClient(follow_redirects=False, event_hooks={"response": [read_bounded]}),
            )  # fmt: skip
        return self._client

    def close(self) -> None:
        """Ends the connection."""
        if self._client is not None:
            self._client.close()
            self._client = None

    def _told(self, error: Any) -> str:
        """What went wrong, in plain words and without the key."""
        import openai

        if isinstance(error, TooLarge) or isinstance(error.__cause__, TooLarge):
            return f"{self.model.host} answers with more than {MOST_BYTES // 10**6} MB; check --base-url"
        if isinstance(error, (openai.APITimeoutError, Late)):
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
        return f"{self.model.host} answers with an error (status {status}): {message}"

    def _without_key(self, words: str) -> str:
        key = api_key(self.model)
        return words.replace(key, "(key)") if key else words


def within(seconds: float, act: Callable[[], Reply]) -> Reply:
    """What a function gives, or raises; `Late` where that takes longer. The timeout of the client is that of one piece of an
    answer, and a server may send one byte after the other."""
    ended: list[Reply | BaseException] = []

    def run() -> None:
        try:
            ended.append(act())
        except BaseException as error:
            ended.append(error)

    thread = threading.Thread(target=run, name="request to a language model", daemon=True)
    thread.start()
    thread.join(seconds)
    if not ended:
        raise Late
    if isinstance(ended[0], BaseException):
        raise ended[0]
    return ended[0]


def read_bounded(response: Any) -> None:
    """Reads the body of an answer of httpx, as far as it may go."""
    parts, size = [], 0
    for part in response.iter_bytes():
        parts.append(part)
        size += len(part)
        if size > MOST_BYTES:
            response.close()
            raise TooLarge
    response._content = b"".join(parts)


def check_installed() -> None:
    """Refuses to go on without the client."""
    try:
        import openai  # noqa: F401
    except ImportError:
        raise InputError(
            f"descriptions by a language model need the package openai, which is not installed; {install('text')}"
        ) from None


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


def _retry_after(error: Any) -> float | None:
    """Seconds that a busy server asks to wait; None where it does not say."""
    response = getattr(error, "response", None)
    given = response.headers.get("retry-after") if response is not None else None
    try:
        wait = float(given) if given is not None else None
    except ValueError:  # a date: the usual pause will do
        return None
    return wait if wait is not None and 0 <= wait < float("inf") else None
