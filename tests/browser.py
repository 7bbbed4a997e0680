"""Headless Chromium, driven over its DevTools protocol: pictures of a page, taps, drags."""

from __future__ import annotations

import asyncio
import base64
import io
import json
import shutil
import subprocess
import tempfile
import time
from collections.abc import Coroutine
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from tornado.websocket import websocket_connect

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser"))), None)
"""Path of the browser, or None."""

PHONE = (390, 844)
"""Size of a common phone's screen, in CSS pixels."""

_PATIENCE = 180.0  # [s]: software draws, perhaps on a busy machine
# A scene says when it is drawn, or that it cannot be; a report is whole once it is loaded.
_DRAWN = """document.readyState === "complete" && document.body && (
  !document.getElementById("scene-data") || document.body.dataset.ready === "true"
  || !document.getElementById("trouble").hidden)"""


class Browser:
    """A browser with one tab.

    Software draws the pictures, so they are the same with and without a graphics card.
    """

    def __init__(self) -> None:
        assert CHROMIUM is not None
        self.requested: list[str] = []
        self.complaints: list[str] = []
        self._profile = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        self._process = subprocess.Popen(
            [
                CHROMIUM,
                "--headless",
                "--no-sandbox",
                "--use-angle=swiftshader",
                "--enable-unsafe-swiftshader",
                "--disable-background-networking",
                "--no-first-run",
                "--hide-scrollbars",
                "--remote-debugging-port=0",
                f"--user-data-dir={self._profile.name}",
                "about:blank",
            ],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        self._loop = asyncio.new_event_loop()
        self._count = 0
        self._shown: tuple[str, tuple[int, int], bool] | None = None
        self._tab = self._run(self._connect())
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.send(f"{domain}.enable")

    def __enter__(self) -> Browser:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._run(self._leave())
        self._process.terminate()
        self._process.wait(_PATIENCE)
        self._loop.close()
        self._profile.cleanup()

    async def _leave(self) -> None:
        self._tab.close()  # in the loop: another test may have left the thread without one
        await asyncio.sleep(0.05)

    def send(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Send a command of the protocol and return its result."""
        self._count += 1
        return self._run(self._ask(self._count, method, parameters))

    def open(self, page: str, size: tuple[int, int], *, touch: bool = False) -> None:
        """Show a page in a window of a size, and wait until it is drawn.

        A page that is there already only gets its fragment, which says all there is to show:
        without a graphics card loading a page takes some seconds.
        """
        path, _, fragment = page.partition("#")
        if (path, size, touch) == self._shown:
            told = f"location.hash = {json.dumps(fragment)}; dispatchEvent(new Event('hashchange'))"
            self.evaluate(told)
            self.settle()
            return
        self._shown = (path, size, touch)
        self.send(
            "Emulation.setDeviceMetricsOverride",
            width=size[0],
            height=size[1],
            deviceScaleFactor=1,
            mobile=touch,
        )
        self.send("Emulation.setTouchEmulationEnabled", enabled=touch)
        self.send("Page.navigate", url="about:blank")  # else a new fragment would load nothing
        self.requested.clear()
        self.complaints.clear()
        self.send("Page.navigate", url=page)
        self.wait_for(_DRAWN)
        self.settle()

    def evaluate(self, expression: str) -> Any:
        """Return the value of a JavaScript expression in the page."""
        answer = self.send(
            "Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def wait_for(self, condition: str) -> None:
        """Wait until a JavaScript expression is true."""
        end = time.monotonic() + _PATIENCE
        while not self.evaluate(condition):
            assert time.monotonic() < end, f"never: {condition}; {self.complaints}"
            self._run(asyncio.sleep(0.05))

    def settle(self) -> None:
        """Wait until what was asked for is on the screen."""
        self.evaluate(
            "new Promise((r) => requestAnimationFrame(() => requestAnimationFrame(() => r(0))))"
        )

    def picture(self) -> np.ndarray:
        """Return what is on the screen, shape (H, W, 3), sRGB in [0, 1]."""
        from PIL import Image

        self.settle()
        data = base64.b64decode(self.send("Page.captureScreenshot", format="png")["data"])
        with Image.open(io.BytesIO(data)) as image:
            return np.asarray(image.convert("RGB"), dtype=np.float64) / 255.0

    def box(self, selector: str) -> tuple[float, float, float, float]:
        """Return left, top, right and bottom of an element on the screen, in CSS pixels."""
        sides = self.evaluate(
            f"(({{left, top, right, bottom}}) => [left, top, right, bottom])"
            f"(document.querySelector({json.dumps(selector)}).getBoundingClientRect())"
        )
        return tuple(sides)

    def press(self, selector: str, *, share: float = 0.5) -> None:
        """Press an element with the mouse: in its middle, or elsewhere along its width."""
        left, top, right, bottom = self.box(selector)
        place = {"x": left + share * (right - left), "y": (top + bottom) / 2.0}
        for kind in ("mousePressed", "mouseReleased"):
            self.send("Input.dispatchMouseEvent", type=kind, button="left", clickCount=1, **place)
        self.settle()

    def tap(self, selector: str, *, share: float = 0.5) -> None:
        """Tap an element with a finger."""
        left, top, right, bottom = self.box(selector)
        place = {"x": left + share * (right - left), "y": (top + bottom) / 2.0}
        self.send("Input.dispatchTouchEvent", type="touchStart", touchPoints=[place])
        self.send("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
        self.settle()

    def swipe(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        """Draw a finger over the screen, in CSS pixels."""
        for share in np.linspace(0.0, 1.0, 6):
            x, y = (float(a + share * (b - a)) for a, b in zip(start, end, strict=True))
            kind = "touchStart" if share == 0.0 else "touchMove"
            self.send("Input.dispatchTouchEvent", type=kind, touchPoints=[{"x": x, "y": y}])
        self.send("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
        self.settle()

    def _run(self, work: Coroutine[Any, Any, Any]) -> Any:
        return self._loop.run_until_complete(asyncio.wait_for(work, _PATIENCE))

    async def _connect(self) -> Any:
        port = Path(self._profile.name) / "DevToolsActivePort"
        while not port.exists() or "\n" not in port.read_text():
            assert self._process.poll() is None, "Chromium did not start"
            await asyncio.sleep(0.05)
        from tornado.httpclient import AsyncHTTPClient

        number = port.read_text().split()[0]
        answer = await AsyncHTTPClient().fetch(f"http://127.0.0.1:{number}/json/list")
        [tab] = [t for t in json.loads(answer.body) if t["type"] == "page"]
        return await websocket_connect(tab["webSocketDebuggerUrl"], max_message_size=10**8)

    async def _ask(self, number: int, method: str, parameters: dict[str, Any]) -> dict[str, Any]:
        await self._tab.write_message(
            json.dumps({"id": number, "method": method, "params": parameters})
        )
        while True:
            text = await self._tab.read_message()
            assert text is not None, "Chromium has gone"
            message = json.loads(text)
            if message.get("id") == number:
                assert "error" not in message, message["error"]
                return message["result"]
            if "method" in message:  # else the answer to a question that was given up
                self._note(message)

    def _note(self, event: dict[str, Any]) -> None:
        details = event.get("params", {})
        if event["method"] == "Network.requestWillBeSent":
            self.requested.append(details["request"]["url"])
        elif event["method"] == "Runtime.exceptionThrown":
            self.complaints.append(str(details["exceptionDetails"]))
        elif event["method"] == "Log.entryAdded" and details["entry"]["level"] == "error":
            self.complaints.append(details["entry"]["text"])
        elif event["method"] == "Runtime.consoleAPICalled" and details["type"] == "error":
            self.complaints.append(str(details["args"]))
