"""A recorded mission, a show of planted messages, and a browser."""

from __future__ import annotations

import json
import shutil
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from flight import settings as flight_settings
from ground.live.shows import about
from ground.live.sources import ConsoleError
from ground.live.view import Told, View
from hal.dictionary import dictionary

SETTINGS = flight_settings.load()


def channels(phase: str, time_s: float, **values: float | bool) -> Told:
    """A message of the channels: zeros, and what is given (double underscores for dots)."""
    found: dict[str, Any] = dict.fromkeys(dictionary().channels, 0.0)
    found |= {name.replace("__", "."): value for name, value in values.items()}
    return Told(None, "channels", {"time_s": time_s, "phase": phase, "hop_index": 0, **found})


class PlantedShow:
    """A live show whose messages the test plants, and which keeps the commands."""

    def __init__(self) -> None:
        self.view, self.lock, self.status = View(), threading.Lock(), ""
        self.refusing = ""
        self.sent: list[tuple[str, dict[str, float]]] = []

    def tell(self, *told: Told) -> None:
        with self.lock:
            for each in told:
                self.view.take(each)

    def about(self) -> dict[str, Any]:
        return about("planted", True, SETTINGS)

    def content(self, query: dict[str, float]) -> dict[str, Any]:
        with self.lock:
            content = {**self.view.content(query.get("after", -1.0)), "status": self.status}
        json.dumps(content, allow_nan=False)
        return content

    def series(self, low_s: float, high_s: float) -> dict[str, Any]:
        return {}

    def command(self, name: str, arguments: dict[str, float]) -> None:
        if self.refusing:
            raise ConsoleError(self.refusing)
        self.sent.append((name, arguments))


@contextmanager
def browser_page(width: int = 1280, height: int = 900) -> Iterator[Any]:
    """A page of headless Chromium that fails the test on any error of a script; skips where there is none."""
    playwright = pytest.importorskip(
        "playwright.sync_api", reason="playwright is not installed (extra 'browser')"
    )
    chromium = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if chromium is None:
        pytest.skip("no Chromium on this computer")
    errors: list[str] = []
    with playwright.sync_playwright() as running:
        browser = running.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": width, "height": height})
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.on("request", lambda request: errors.extend(foreign(request.url)))
        yield page
        browser.close()
    assert errors == []


def foreign(url: str) -> list[str]:
    """An address that is not on this computer."""
    return [] if url.startswith(("http://127.0.0.1", "data:", "blob:", "file:")) else [url]
