"""Endpoints of language models that answer with anything: pieces of HTTP, endless bytes, redirections, JSON of other things."""

from __future__ import annotations

import gzip
import json
import os
import socket
import threading
import time
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

import numpy as np

from t2d_rt.motion.descriptions.language_model import LanguageModel, TokenBudget, model_descriptions
from validation.robustness.fuzz.case import DEEP, Attempt, Wrong, check_text, corrupted, pick, replaced, writing_only

LONGEST_S = 1.0
REQUESTS = 3
LATE_S = 30.0
"""How much later than its limit an answer may be on a busy machine; those without end last for longer than 100 s."""


class Server:
    """Writes bytes as they are, piece by piece with pauses, to whoever asks."""

    def __init__(self, pieces: Iterable[bytes], pause_s: float = 0.0) -> None:
        self._over, self._socket = threading.Event(), socket.create_server(("127.0.0.1", 0))
        self.url = f"http://127.0.0.1:{self._socket.getsockname()[1]}/v1"

        def serve() -> None:
            with suppress(OSError):
                while True:
                    connection, _ = self._socket.accept()
                    with connection, suppress(OSError):
                        connection.settimeout(0.1)  # what stays unread would reset the connection
                        with suppress(TimeoutError):
                            while connection.recv(65536):
                                pass
                        connection.settimeout(None)
                        for piece in pieces:
                            connection.sendall(piece)
                            if self._over.wait(pause_s):
                                return

        threading.Thread(target=serve, daemon=True).start()

    def close(self) -> None:
        """Ends what is written, and takes no more requests."""
        self._over.set()
        self._socket.shutdown(socket.SHUT_RDWR)
        self._socket.close()


def attempt(rng: np.random.Generator, folder: Path) -> Attempt:
    """One way to answer, and a request for descriptions."""
    os.environ["T2D_RT_CACHE"] = "off"
    os.environ["T2D_API_KEY"] = "sk-secret"
    told, pieces, pause_s = _answer(rng)
    return Attempt(f"{told}: model_descriptions", writing_only(lambda: _asked(pieces, pause_s), folder, "nowhere"))


def _answer(rng: np.random.Generator) -> tuple[str, list[bytes], float]:
    row = {
        "class": "falling",
        "action": "fall",
        "type": "trip",
        "direction": "forward",
        "sentence": "A man trips and falls forward.",
    }
    how, values = replaced(rng, {"descriptions": [row, row]})
    text = pick(
        rng, (json.dumps(values), json.dumps(values), DEEP, "null", "```json\n{}\n```", "a" * 300_000, "\x1b[31m")
    )
    completion = {
        "id": "1", "object": "chat.completion", "created": 1, "model": "m", "usage": {"total_tokens": 10},
        "choices": [{"index": 0, "finish_reason": "stop", "message": {"role": "assistant", "content": text}}],
    }  # fmt: skip
    kind = pick(
        rng,
        ("text", "text", "completion", "completion", "head", "drip", "large", "gzip", "redirect", "bytes", "status"),
    )
    if kind == "completion":
        how, completion = replaced(rng, completion)
    body = json.dumps(completion).encode()
    head = b"HTTP/1.1 200 OK\r\ncontent-type: application/json\r\nconnection: close\r\n"
    whole = head + b"content-length: %d\r\n\r\n" % len(body) + body
    if kind == "head":
        return "a header without end", [head, *([b"x-a: 1\r\n"] * 5000)], 0.05
    if kind == "drip":
        return "one byte after the other", [head + b"\r\n", *([b" "] * 5000)], 0.02
    if kind == "large":
        return "a body without end", [head + b"\r\n", *([b" " * 2**20] * 50)], 0.0
    if kind == "gzip":
        return "a bomb", [head + b"content-encoding: gzip\r\n\r\n" + gzip.compress(b" " * 2**27)], 0.0
    if kind == "redirect":
        return "a redirection", [b"HTTP/1.1 307 Elsewhere\r\nlocation: http://127.0.0.1:9/\r\n\r\n"], 0.0
    if kind == "status":
        code = int(rng.integers(100, 600))
        return f"status {code}", [b"HTTP/1.1 %d x\r\ncontent-length: 4\r\nretry-after: nan\r\n\r\nnull" % code], 0.0
    if kind == "bytes":
        how, whole = corrupted(rng, whole)
    return f"{kind} {how}", [whole], 0.0


def _asked(pieces: list[bytes], pause_s: float) -> None:
    server = Server(pieces, pause_s)
    begin = time.monotonic()
    try:
        found = model_descriptions(
            "falling", 2, model=LanguageModel(model="m", base_url=server.url, timeout_s=LONGEST_S, tries=2),
            budget=TokenBudget(requests=REQUESTS),
        )  # fmt: skip
        check_text(str(found), what="the count", lines=1)
    finally:
        server.close()
        if time.monotonic() - begin > REQUESTS * LONGEST_S + LATE_S:
            raise Wrong(f"{time.monotonic() - begin:.1f} s for {REQUESTS} requests of {LONGEST_S:g} s")
