"""A headless Chromium, driven through its DevTools protocol: what a page looks like and says in a real browser."""

from __future__ import annotations

import base64
import contextlib
import itertools
import json
import os
import shutil
import subprocess
import time
import urllib.request
from pathlib import Path
from typing import Any

import pytest
import websocket

START_S, REPLY_S = 60.0, 60.0


def find() -> str | None:
    """Debian's chromium, or Chrome under one of its names."""
    return next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None)


def needed() -> str:
    """The browser; without one the test is skipped, but fails where $CI or $SINS_ENV_BROWSER=required says so."""
    path = find()
    if path is None:
        missing = "no Chromium on the path (Debian: apt-get install chromium)"
        required = os.environ.get("CI") or os.environ.get("SINS_ENV_BROWSER") == "required"
        (pytest.fail if required else pytest.skip)(missing)
    return str(path)


class Browser:
    """One process; a context manager. ``directory`` holds its profile."""

    def __init__(self, directory: Path) -> None:
        self.profile = directory / "profile"
        self.profile.mkdir(parents=True, exist_ok=True)
        flags = ["--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--hide-scrollbars"]
        flags += ["--no-first-run", "--disable-extensions", "--disable-background-networking", "--mute-audio"]
        flags += ["--remote-debugging-port=0", "--remote-allow-origins=*", f"--user-data-dir={self.profile}"]
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "start_new_session": True}
        self.process = subprocess.Popen([needed(), *flags, "about:blank"], **quiet)
        self.port = self._port()

    def _port(self) -> int:
        """Written by the browser once it listens."""
        file, end = self.profile / "DevToolsActivePort", time.monotonic() + START_S
        while time.monotonic() < end and self.process.poll() is None:
            if file.exists() and (lines := file.read_text().splitlines()):
                return int(lines[0])
            time.sleep(0.05)
        self.close()
        raise RuntimeError(f"{needed()} did not start within {START_S:.0f} s")

    def __enter__(self) -> Browser:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        self.process.terminate()
        try:
            self.process.wait(10)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()

    def page(self, url: str, width: int, height: int = 900, dark: bool = False, scripts: bool = True) -> Page:
        """A loaded page, a context manager; narrower than 600 px it is a phone's."""
        request = urllib.request.Request(f"http://127.0.0.1:{self.port}/json/new?about:blank", method="PUT")
        with urllib.request.urlopen(request, timeout=REPLY_S) as reply:
            target = json.load(reply)
        return Page(target["webSocketDebuggerUrl"], url, (width, height), dark, scripts)


class Page:
    """A tab. ``log`` is everything that the console or the network complained of; ``requests`` what it asked for."""

    def __init__(self, socket: str, url: str, size: tuple[int, int], dark: bool, scripts: bool) -> None:
        self.size, self.log, self.requests = size, [], []
        self._socket = websocket.create_connection(socket, timeout=REPLY_S)
        self._numbers, self._loaded = itertools.count(1), False
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")
        phone = size[0] < 600
        metrics = {"width": size[0], "height": size[1], "deviceScaleFactor": 2 if phone else 1, "mobile": phone}
        self.call("Emulation.setDeviceMetricsOverride", **metrics)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.call("Emulation.setEmulatedMedia", features=[scheme])
        self.call("Emulation.setScriptExecutionDisabled", value=not scripts)
        self.call("Page.navigate", url=url)
        while not self._loaded:
            self._take(json.loads(self._socket.recv()))

    def __enter__(self) -> Page:
        return self

    def __exit__(self, *_: object) -> None:
        with contextlib.suppress(Exception):
            self.call("Page.close")
        self._socket.close()

    def call(self, method: str, **params: Any) -> dict[str, Any]:
        number = next(self._numbers)
        self._socket.send(json.dumps({"id": number, "method": method, "params": params}))
        while True:
            message = json.loads(self._socket.recv())
            if message.get("id") != number:
                self._take(message)
            elif "error" in message:
                raise RuntimeError(f"{method}: {message['error']['message']}")
            else:
                return dict(message["result"])

    def _take(self, message: dict[str, Any]) -> None:
        method, params = message.get("method"), message.get("params", {})
        if method == "Page.loadEventFired":
            self._loaded = True
        elif method == "Runtime.exceptionThrown":
            self.log.append(params["exceptionDetails"]["text"])
        elif method == "Runtime.consoleAPICalled" and params["type"] in ("error", "warning", "assert"):
            self.log.append(str(params["args"]))
        elif method == "Log.entryAdded":
            self.log.append(params["entry"]["text"])
        elif method == "Network.loadingFailed":
            self.log.append(params["errorText"])
        elif method == "Network.requestWillBeSent":
            self.requests.append(params["request"]["url"])

    def value(self, expression: str) -> Any:
        """Of JavaScript evaluated in the page, also where the page's own is off."""
        found = self.call("Runtime.evaluate", expression=expression, returnByValue=True)
        if "exceptionDetails" in found:
            raise RuntimeError(f"{expression}: {found['exceptionDetails']}")
        return found["result"].get("value")

    def screenshot(self, path: Path, whole: bool = True) -> None:
        found = self.call("Page.captureScreenshot", format="png", captureBeyondViewport=whole)
        path.write_bytes(base64.b64decode(found["data"]))
