"""Descriptions by a language model, against a stub of an endpoint on this machine: success, every failure, and the key."""

from __future__ import annotations

import builtins
import gzip
import itertools
import json
import logging
import sys
import threading
import time
from collections.abc import Callable, Iterator
from functools import cache
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from command_line import Command
from t2d_rt.core import disk_cache
from t2d_rt.core.disk_cache import VARIABLE
from t2d_rt.core.errors import InputError
from t2d_rt.motion.descriptions import language_model
from t2d_rt.motion.descriptions.grammar import grammar_descriptions
from t2d_rt.motion.descriptions.language_model import (
    MOST_FAILURES,
    LanguageModel,
    TokenBudget,
    Written,
    json_schema,
    model_descriptions,
    rows_of,
)
from t2d_rt.motion.descriptions.openai_client import Session
from t2d_rt.motion.descriptions.slots import ACTIONS_OF, ACTIVITIES, Description, as_json, read_descriptions
from validation.robustness.fuzz.endpoint import Server

KEY = "sk-very-secret-0123456789"

Answer = Callable[[Any], tuple[int, dict[str, str], bytes]]


@cache
def pool() -> list[dict[str, Any]]:
    """What the stub's model writes."""
    return [as_json(each) for each in grammar_descriptions("falling", 150, seed=99)]


def body_of(text: str) -> bytes:
    return json.dumps({"choices": [{"index": 0, "finish_reason": "stop", "message": {"content": text}}]}).encode()


HEAD = b"HTTP/1.1 200 OK\r\ncontent-type: application/json\r\n"
MEGABYTE = b" " * 2**20


@pytest.mark.parametrize(
    ("pieces", "pause_s", "sentence"),
    [
        ([HEAD, *([b"x-a: 1\r\n"] * 10_000)], 0.05, "did not answer within 1 s"),
        ([HEAD + b"\r\n", *([b" "] * 10_000)], 0.05, "did not answer within 1 s"),
        ([HEAD + b"\r\n", *([MEGABYTE] * 100)], 0.0, "answers with more than 8 MB"),
        ([HEAD + b"content-encoding: gzip\r\n\r\n" + gzip.compress(MEGABYTE * 64)], 0.0, "answers with more than 8 MB"),
        ([HEAD + b"\r\n" + b"[" * 200_000 + b"]" * 200_000], 0.0, "could not be used"),
        ([HEAD + b"\r\n" + body_of("[" * 200_000)], 0.0, "could not be used"),
        ([HEAD + b"\r\nnull"], 0.0, "could not be used"),
        ([HEAD + b'\r\n{"choices": {}}'], 0.0, "could not be used"),
        ([b"HTTP/1.1 302 Found\r\nlocation: http://127.0.0.1:1/v1\r\n\r\n"], 0.0, "sends requests on to another address"),
        ([b"SSH-2.0-OpenSSH_9.2\r\n"], 0.0, "cannot be reached"),
    ],
)  # fmt: skip
def test_servers_that_never_end(pieces: list[bytes], pause_s: float, sentence: str) -> None:
    server = Server(pieces, pause_s)
    begin = time.monotonic()
    try:
        with pytest.raises(InputError, match=sentence):
            model_descriptions(
                "falling", 5, model=LanguageModel(model="m", base_url=server.url, timeout_s=1.0, tries=1),
            )  # fmt: skip
    finally:
        server.close()
    assert time.monotonic() - begin < 60  # one that is read to its end takes 500 s


class Endpoint:
    """A server that answers each request with the next of its answers, then with good ones."""

    def __init__(self) -> None:
        self.answers: list[Answer] = []
        self.requests: list[dict[str, Any]] = []
        self.keys: list[str] = []
        self._pool = iter(pool())
        outer = self

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                body = json.loads(self.rfile.read(int(self.headers["content-length"])))
                outer.requests.append(body)
                outer.keys.append(self.headers.get("authorization", ""))
                answer = outer.answers.pop(0) if outer.answers else outer.good
                status, headers, data = answer(body)
                try:
                    self.send_response(status)
                    for name, value in {"content-type": "application/json", **headers}.items():
                        self.send_header(name, value)
                    self.send_header("content-length", str(len(data)))
                    self.end_headers()
                    self.wfile.write(data)
                except OSError:  # who asked has gone
                    pass

            def log_message(self, *_: Any) -> None:
                pass

        self.server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.thread = threading.Thread(target=self.server.serve_forever, kwargs={"poll_interval": 0.01})
        self.thread.start()
        self.url = f"http://127.0.0.1:{self.server.server_address[1]}/v1"

    def good(self, _: Any) -> tuple[int, dict[str, str], bytes]:
        return completion(json.dumps({"descriptions": list(itertools.islice(self._pool, 10))}))

    def close(self) -> None:
        self.server.shutdown()
        self.thread.join()
        self.server.server_close()


def completion(
    content: str | None, *, refusal: str | None = None, reason: str = "stop"
) -> tuple[int, dict[str, str], bytes]:
    """A chat completion as the API gives it."""
    message = {"role": "assistant", "content": content, "refusal": refusal}
    found = {
        "id": "1", "object": "chat.completion", "created": 0, "model": "stub",
        "choices": [{"index": 0, "finish_reason": reason, "message": message}],
        "usage": {"prompt_tokens": 700, "completion_tokens": 300, "total_tokens": 1000},
    }  # fmt: skip
    return 200, {}, json.dumps(found).encode()


def says(content: str | None, **more: Any) -> Answer:
    return lambda _: completion(content, **more)


def fails(status: int, message: str = "no", **headers: str) -> Answer:
    data = json.dumps({"error": {"message": message, "code": message}}).encode()
    return lambda _: (status, {name.replace("_", "-"): value for name, value in headers.items()}, data)


@pytest.fixture
def endpoint(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Endpoint]:
    for name in ("OPENAI_API_KEY", "OPENAI_BASE_URL", "HTTP_PROXY", "http_proxy", "ALL_PROXY", "all_proxy"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("T2D_API_KEY", KEY)
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")
    monkeypatch.setenv(VARIABLE, str(tmp_path / "kept"))
    found = Endpoint()
    yield found
    found.close()


@pytest.fixture
def ask(endpoint: Endpoint, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Written]:
    """`ask(count, ...)`: what the stub's model wrote, without pauses that grow."""
    monkeypatch.setattr("openai._base_client.INITIAL_RETRY_DELAY", 0.0)

    def asked(count: int = 8, *, budget: TokenBudget | None = None, **model: Any) -> Written:
        made = LanguageModel(**{"model": "stub", "base_url": endpoint.url, "timeout_s": 10.0, **model})
        return model_descriptions("falling", count, model=made, budget=budget)

    return asked


Ask = Callable[..., Written]


def test_descriptions_come_from_the_model(endpoint: Endpoint, ask: Ask) -> None:
    written = ask(25)
    assert len(written.descriptions) == 25
    assert written.stopped == ""
    assert (written.requests, written.tokens, written.cached) == (3, 3000, 0)
    assert len({each.sentence for each in written.descriptions}) == 25
    assert endpoint.keys == [f"Bearer {KEY}"] * 3
    first = endpoint.requests[0]
    assert first["model"] == "stub"
    assert first["response_format"]["type"] == "json_schema"
    assert first["response_format"]["json_schema"]["strict"] is True
    assert first["response_format"]["json_schema"]["schema"] == json_schema("falling")
    prompt = first["messages"][1]["content"]
    assert "Write 10 descriptions" in prompt
    assert prompt.count('"action": "fall"') == 10
    assert endpoint.requests[1]["messages"] != first["messages"]  # other properties
    assert "25 of 25 descriptions from 3 requests" in str(written)


@pytest.mark.parametrize("activity", ACTIVITIES)
def test_schema_is_as_strict_as_structured_output_wants(activity: Any) -> None:
    def objects(schema: Any) -> Iterator[dict[str, Any]]:
        if isinstance(schema, dict):
            if schema.get("type") == "object":
                yield schema
            for each in schema.values():
                yield from objects(each)

    found = list(objects(json_schema(activity)))
    assert len(found) >= 3
    for each in found:
        assert each["required"] == list(each["properties"])
        assert each["additionalProperties"] is False
    schema = json_schema(activity)
    name = schema["properties"]["descriptions"]["items"]["$ref"].rpartition("/")[2]
    item = schema["$defs"][name]["properties"]
    assert set(item) == set(as_json(grammar_descriptions(activity, 1)[0])) - {"class"}
    assert item["action"].get("enum", [item["action"].get("const")]) == list(ACTIONS_OF[activity])
    assert ({"type": "null"} in item["type"].get("anyOf", [item["type"]])) == (activity != "abnormal_walking")


def test_replies_are_kept_and_not_asked_for_again(endpoint: Endpoint, ask: Ask) -> None:
    first = ask(18)
    again = ask(18)
    assert again.descriptions == first.descriptions
    assert (again.requests, again.tokens, again.cached) == (0, 0, 2)
    assert len(endpoint.requests) == 2
    other = ask(8, model="another")
    assert other.requests == 1


def test_damaged_entries_are_made_again(endpoint: Endpoint, ask: Ask, tmp_path: Path) -> None:
    ask(8)
    (entry,) = (tmp_path / "kept").iterdir()
    entry.write_bytes(entry.read_bytes()[:200])
    assert language_model.kept_reply(entry.stem) is None
    assert ask(8).requests == 1
    assert language_model.kept_reply(entry.stem) is not None
    disk_cache.write(entry.stem, {"reply": np.array([0xFF, 0xFE], np.uint8)})
    assert language_model.kept_reply(entry.stem) is None


def test_cache_may_be_off_or_unwritable(ask: Ask, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv(VARIABLE, "off")
    assert ask(8).requests == 1
    (tmp_path / "file").touch()
    monkeypatch.setenv(VARIABLE, str(tmp_path / "file"))
    assert ask(8).requests == 1


@pytest.mark.parametrize("bad", ["{not json", "", None, '{"falls": []}', '"text"', "[" * 100_000, "x" * 300_000])
def test_unusable_replies_are_asked_for_again(endpoint: Endpoint, ask: Ask, bad: str | None) -> None:
    endpoint.answers = [says(bad)]
    written = ask(8)
    assert len(written.descriptions) == 8
    assert (written.requests, written.malformed) == (2, 1)
    assert endpoint.requests[0]["seed"] != endpoint.requests[1]["seed"]
    assert "1 unusable replies" in str(written)


def test_json_in_a_fence_is_read() -> None:
    assert rows_of('```json\n{"descriptions": [1]}\n```') == [1]
    assert rows_of("[2]") == [2]


def test_a_model_that_never_answers_in_json_is_given_up(endpoint: Endpoint, ask: Ask) -> None:
    endpoint.answers = [says("Sure! Here are ten falls.")] * 20
    with pytest.raises(InputError, match=f"no description was made: {MOST_FAILURES} replies in a row .* is no JSON"):
        ask(8)
    assert len(endpoint.requests) == MOST_FAILURES


def test_what_does_not_fit_the_schema_is_left_out(endpoint: Endpoint, ask: Ask) -> None:
    good = [as_json(each) for each in grammar_descriptions("falling", 9, seed=5)]
    bad = [
        {**good[0], "direction": "up"}, {**good[0], "action": "fly"}, {**good[0], "hat": 1}, {**good[0], "class": "sitting"},
        {**good[0], "sentence": ""}, {**good[0], "before": "walk"}, {**good[0], "before": [{"action": "x"}]}, 7, None,
        {"sentence": "A man falls."},
    ]  # fmt: skip
    contradicting = [
        {**good[0], "type": "slip", "sentence": "A man trips and falls."},
        {**good[0], "sentence": "A man sits down on a chair."},
    ]
    free = {**good[0], "sentence": "Gravity wins over an unlucky gentleman."}
    rows = [*bad, *contradicting, free, good[8], good[8]]
    endpoint.answers = [says(json.dumps({"descriptions": rows}))]
    written = ask(2)
    assert [each.sentence for each in written.descriptions] == [free["sentence"], good[8]["sentence"]]
    assert (written.invalid, written.disagreeing, written.unchecked, written.near_duplicates) == (len(bad), 2, 1, 1)


def test_nulls_of_the_schema_are_read(endpoint: Endpoint, ask: Ask) -> None:
    row = {name: None for name in as_json(grammar_descriptions("falling", 1)[0]) if name != "class"}
    row |= {"action": "fall", "sentence": "A man falls.", "before": [{**row, "action": "walk"}]}
    row["before"] = [{name: row["before"][0].get(name) for name in ("action", "manner", "speed", "type", "count")}]
    endpoint.answers = [says(json.dumps([row]))]
    written = ask(1)
    assert written.descriptions[0].before[0].speed == "normal"


def test_refusals_are_told(endpoint: Endpoint, ask: Ask) -> None:
    endpoint.answers = [says(None, refusal="I cannot help with falls.")]
    written = ask(8)
    assert (written.refusals, written.requests) == (1, 2)
    endpoint.answers = [says(None, refusal="I cannot help with falls.")] * 9
    with pytest.raises(InputError, match=r"the model refused .'I cannot help with falls"):
        ask(8, model="other")
    endpoint.answers = [says("", reason="content_filter")] * 9
    with pytest.raises(InputError, match=r"refused .'its content filter'"):
        ask(8, model="third")


def test_a_reply_cut_short_is_told(endpoint: Endpoint, ask: Ask) -> None:
    endpoint.answers = [says('{"descriptions": [{"act', reason="length")] * 9
    with pytest.raises(InputError, match="the reply was cut short"):
        ask(8)


def test_a_busy_server_is_waited_for(endpoint: Endpoint, ask: Ask) -> None:
    endpoint.answers = [fails(429, retry_after="0.4"), fails(503), fails(500), fails(409)]
    begin = time.monotonic()
    written = ask(8)
    assert (len(written.descriptions), written.requests) == (8, 5)
    assert time.monotonic() - begin > 0.4


@pytest.mark.parametrize(
    ("answers", "message", "requests"),
    [
        ([fails(429, "slow down")] * 9, r"status 429\): slow down \(5 tries\)", 5),
        ([fails(429, retry_after="3600")] * 9, "asks to wait 3600 s; try again later", 1),
        ([fails(429, "insufficient_quota")] * 9, "insufficient_quota", 1),
        ([fails(500)] * 9, r"status 500\)", 5),
        ([fails(401, f"Incorrect API key: {KEY}")] * 9, r"refuses the key \(status 401\); set T2D_API_KEY", 1),
        ([fails(404)] * 9, "knows no model 'stub'", 1),
        ([fails(400, "context length exceeded")] * 9, "context length exceeded", 1),
        ([fails(418, f"teapot {KEY}")] * 9, r"status 418\): .*teapot \(key\)", 1),
        ([lambda _: (200, {}, b"<html>")] * 9, "is no JSON", MOST_FAILURES),
        ([lambda _: (200, {}, b'{"choices": []}')] * 9, "is no JSON", MOST_FAILURES),
    ],
)  # fmt: skip
def test_failures_are_told_in_a_sentence(
    endpoint: Endpoint, ask: Ask, answers: list[Answer], message: str, requests: int
) -> None:
    endpoint.answers = answers
    with pytest.raises(InputError, match=f"no description was made: .*({message})") as failure:
        ask(8)
    assert "\n" not in str(failure.value)
    assert KEY not in str(failure.value)
    assert len(endpoint.requests) == requests


def test_servers_without_schemas_are_asked_more_simply(endpoint: Endpoint, ask: Ask) -> None:
    endpoint.answers = [fails(400, "response_format json_schema is unknown"), fails(422)]
    written = ask(14)
    assert len(written.descriptions) == 14
    formats = [each["response_format"]["type"] for each in endpoint.requests]
    assert formats == ["json_schema", "json_object", "text", "text"]
    assert '"additionalProperties"' in endpoint.requests[2]["messages"][1]["content"]


def test_a_slow_server_is_given_up(endpoint: Endpoint, ask: Ask) -> None:
    def slow(_: Any) -> tuple[int, dict[str, str], bytes]:
        time.sleep(0.4)
        return completion("{}")

    endpoint.answers = [slow, slow]
    with pytest.raises(InputError, match=r"did not answer within 0.1 s \(2 tries\)"):
        ask(8, timeout_s=0.1, tries=2)


def test_a_missing_server_is_told(ask: Ask) -> None:
    with pytest.raises(InputError, match=r"127.0.0.1:9 cannot be reached; check --base-url .*\(5 tries\)"):
        ask(8, base_url="http://127.0.0.1:9/v1")


def test_budgets_are_kept_and_what_was_made_is_given(endpoint: Endpoint, ask: Ask) -> None:
    written = ask(50, budget=TokenBudget(requests=2))
    assert (len(written.descriptions), written.requests, len(endpoint.requests)) == (20, 2, 2)
    assert written.stopped == "the budget of 2 requests is used up"
    written = ask(50, model="other", budget=TokenBudget(tokens=4500))
    assert (written.tokens, written.requests) == (4000, 4)
    assert "the budget of 4500 tokens is used up (4000 spent" in written.stopped
    endpoint.answers = [fails(500)] * 9
    with pytest.raises(InputError, match="the budget of 3 requests is used up"):
        ask(8, model="third", budget=TokenBudget(requests=3))
    with pytest.raises(InputError, match="the budget of 1 tokens is used up"):
        ask(8, model="fourth", budget=TokenBudget(tokens=1))


def test_no_endless_run_without_a_budget(endpoint: Endpoint, ask: Ask) -> None:
    same = json.dumps({"descriptions": [as_json(grammar_descriptions("falling", 1, seed=5)[0])]})
    endpoint.answers = [says(same)] * 60
    written = ask(8)
    assert len(written.descriptions) == 1
    assert "nothing in the reply was valid and new" in written.stopped


def test_a_local_endpoint_needs_no_key(endpoint: Endpoint, ask: Ask, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("T2D_API_KEY")
    assert len(ask(8).descriptions) == 8
    assert KEY not in endpoint.keys[0]
    with pytest.raises(InputError, match=r"api.openai.com needs a key; set T2D_API_KEY or OPENAI_API_KEY"):
        model_descriptions("falling", 1, model=LanguageModel(model="m"))


def test_the_key_is_nowhere(
    endpoint: Endpoint, ask: Ask, caplog: pytest.LogCaptureFixture, capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    caplog.set_level(logging.DEBUG)
    row = {**as_json(grammar_descriptions("falling", 1, seed=5)[0]), "sentence": f"A man falls; {KEY}."}
    endpoint.answers = [fails(429, f"key {KEY}"), fails(500, KEY), says(KEY), says(json.dumps([row]))]
    written = ask(8)
    assert len(written.descriptions) == 8
    assert len(endpoint.requests) == 5
    assert all(KEY in each for each in endpoint.keys)
    endpoint.answers = [fails(403, KEY)]
    with pytest.raises(InputError) as failure:
        ask(8, model="other")
    files = [path.read_bytes().decode("latin-1") for path in tmp_path.rglob("*") if path.is_file()]
    assert len(files) >= 2
    model = LanguageModel(model="m", base_url=endpoint.url)
    session = Session(model, TokenBudget())
    shown = [
        repr(model), str(written), repr(written), repr(session), str(failure.value), *files, *capfd.readouterr(),
        caplog.text,
    ]  # fmt: skip
    session.close()
    assert caplog.text
    assert not [each for each in shown if KEY in each]
    context: BaseException | None = failure.value
    while context is not None:  # no chained error that a traceback would print
        assert KEY not in str(context)
        context = context.__cause__ or (None if context.__suppress_context__ else context.__context__)


@pytest.mark.parametrize(
    ("url", "message"),
    [
        (f"http://user:{KEY}@host/v1", "must hold no user, key or query"),
        (f"https://host/v1?key={KEY}", "must hold no user, key or query"),
        ("ftp://host", "must be an address such as"),
        ("localhost:8000", "must be an address such as"),
        ("http://host:99999999", "is no address"),
        ("", None),
    ],
)
def test_addresses_are_checked(url: str, message: str | None) -> None:
    if message is None:
        assert LanguageModel(model="m", base_url=url).host == "api.openai.com"
        return
    with pytest.raises(InputError, match=message) as failure:
        LanguageModel(model="m", base_url=url)
    assert KEY not in str(failure.value)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"model": " "}, "model must name"), ({"timeout_s": 0}, "timeout_s must be positive"), ({"tries": 0}, "tries"),
        ({"model": 5}, "model must be a text"),
    ],
)  # fmt: skip
def test_settings_are_checked(fields: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        LanguageModel(**{"model": "m", **fields})
    with pytest.raises(InputError, match="budget of requests"):
        TokenBudget(requests=0)


def test_a_missing_client_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def without(name: str, *arguments: Any, **more: Any) -> Any:
        if name.partition(".")[0] == "openai":
            raise ImportError
        return real(name, *arguments, **more)

    monkeypatch.delitem(sys.modules, "t2d_rt.motion.descriptions.openai_client", raising=False)
    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(InputError, match=r"need the package openai, .* pip install -e '.\[text\]'"):
        model_descriptions("falling", 1, model=LanguageModel(model="m"))


def test_command_asks_a_model(endpoint: Endpoint, run: Command) -> None:
    named = ["--source", "openai", "--model", "stub", "--base-url", endpoint.url]
    code, out, err = run("describe", "--class", "falling", "-n", "12", "-o", "a.jsonl", *named)
    assert (code, len(read_descriptions("a.jsonl"))) == (0, 12)
    assert "12 of 12 descriptions from 2 requests" in err
    code, out, err = run("describe", "--class", "falling", "-n", "40", "-o", "b.jsonl", "--budget", "1", *named)
    assert code == 1
    assert len(read_descriptions("b.jsonl")) == 30  # two batches were kept on disk, one was asked for
    assert "only 30 of 40 descriptions of falling were made: the budget of 1 requests is used up" in err
    assert KEY not in out + err


def test_command_writes_nothing_where_nothing_was_made(endpoint: Endpoint, refused: Callable[..., str]) -> None:
    endpoint.answers = [fails(401, KEY)]
    named = ["--source", "openai", "--model", "m", "--base-url", endpoint.url]
    sentence = refused("describe", "--class", "falling", "-n", "3", "-o", "a.jsonl", *named)
    assert "refuses the key" in sentence
    assert KEY not in sentence


def test_descriptions_of_the_stub_are_sound() -> None:
    row = as_json(grammar_descriptions("falling", 1)[0])
    assert Description.model_validate(row).sentence == row["sentence"]
