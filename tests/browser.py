"""Headless Chromium without network and without a graphics card, driven over the DevTools protocol by a pipe; what pages hold."""

from __future__ import annotations

import base64
import json
import os
import re
import select
import shutil
import subprocess
import time
import zlib
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
FLAGS = (
    "--headless=new", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--hide-scrollbars",
    "--disable-dev-shm-usage", "--host-resolver-rules=MAP * ~NOTFOUND", "--remote-debugging-pipe",
)  # fmt: skip
LONGEST_S = 60.0
KINDS = {"u1": np.uint8, "u2": np.uint16, "u4": np.uint32, "f4": np.float32}
"""Of arrays in a page."""
TOLD = "Runtime.exceptionThrown", "Runtime.consoleAPICalled", "Log.entryAdded"
"""What a page says on its console."""


class Browser:
    """One window; `with Browser(folder) as browser`, which keeps its profile in that folder."""

    def __init__(self, folder: Path, width: int = 1280, height: int = 800) -> None:
        assert CHROMIUM is not None
        (hears, self._asks), (self._gets, says) = os.pipe(), os.pipe()
        command = [CHROMIUM, *FLAGS, f"--user-data-dir={folder}", f"--window-size={width},{height}", "about:blank"]
        # The browser reads from descriptor 3 and writes to 4.
        shell = f'exec 3<&{hears} 4>&{says}; exec "$@"'
        self._process = subprocess.Popen(
            ["/bin/bash", "-c", shell, "browser", *command], pass_fds=(hears, says), stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )  # fmt: skip
        for each in (hears, says):
            os.close(each)
        self._number, self._rest, self._session = 0, b"", ""
        self.told: list[dict[str, Any]] = []
        """Messages and errors of the page's console so far."""
        self.requests: list[str] = []
        """Addresses that the page has asked for."""
        (window,) = (each for each in self.call("Target.getTargets")["targetInfos"] if each["type"] == "page")
        self._session = self.call("Target.attachToTarget", targetId=window["targetId"], flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)

    def __enter__(self) -> Browser:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._process.kill()
        self._process.wait(LONGEST_S)
        for each in (self._asks, self._gets):
            os.close(each)

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """The result of a call of the protocol; what the page says meanwhile is kept."""
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._asks, json.dumps(message).encode() + b"\0")
        while True:
            found = self._next()
            if found.get("id") == self._number:
                assert "error" not in found, found
                return dict(found["result"])
            if found.get("method") in TOLD:
                self.told.append(found["params"])
            if found.get("method") == "Network.requestWillBeSent":
                self.requests.append(found["params"]["request"]["url"])

    def _next(self) -> dict[str, Any]:
        until = time.monotonic() + LONGEST_S
        while b"\0" not in self._rest:
            ready, _, _ = select.select([self._gets], [], [], max(0.0, until - time.monotonic()))
            assert ready, "the browser does not answer"
            some = os.read(self._gets, 1 << 20)
            assert some, "the browser has ended"
            self._rest += some
        one, _, self._rest = self._rest.partition(b"\0")
        return dict(json.loads(one))

    def run(self, script: str) -> Any:
        """The value of an expression in the page, once it is there."""
        found = self.call("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in found, found["exceptionDetails"]
        return found["result"].get("value")

    def open(self, page: Path, place: str = "") -> float:
        """Shows a file; gives the seconds from the start of the page until its first picture."""
        self.call("Page.navigate", url="about:blank")
        self.call("Page.navigate", url=f"{page.as_uri()}{place}")
        until = time.monotonic() + LONGEST_S
        while not self.run("document.body ? document.body.dataset.ready || '' : ''"):
            assert not self.told, self.told
            assert time.monotonic() < until, "the page is not ready"
            time.sleep(0.05)
        return float(self.run("document.body.dataset.ready")) / 1e3

    def click(self, x: float, y: float) -> None:
        """With the mouse, at a place of the window."""
        for kind in ("mousePressed", "mouseReleased"):
            self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)

    def press(self, key: str, text: str = "") -> None:
        """A key."""
        self.call("Input.dispatchKeyEvent", type="keyDown", key=key, text=text)
        self.call("Input.dispatchKeyEvent", type="keyUp", key=key)

    def picture(self, box: Sequence[float] | None = None) -> bytes:
        """What the window shows as PNG, or a part of it (x, y, width, height)."""
        clip = (
            {} if box is None else {"clip": {**dict(zip(("x", "y", "width", "height"), box, strict=True)), "scale": 1}}
        )
        return base64.b64decode(self.call("Page.captureScreenshot", format="png", **clip)["data"])


def numbers(html: str) -> Any:
    """What a page holds, with its arrays."""
    meta, packed = (
        re.findall(rf'<script id="{name}"[^>]*>(.*?)</script>', html, re.DOTALL)[0] for name in ("meta", "data")
    )
    data = zlib.decompress(base64.b64decode(packed))

    def read(value: Any) -> Any:
        if isinstance(value, list):
            return [read(each) for each in value]
        if not isinstance(value, dict):
            return value
        if "at" not in value:
            return {name: read(each) for name, each in value.items()}
        array = np.frombuffer(data, KINDS[value["kind"]], value["count"], value["at"]).copy()
        if "deltas" in value:
            return array.reshape(-1, value["deltas"]).cumsum(axis=0, dtype=np.uint16)
        return array

    return read(json.loads(meta))
