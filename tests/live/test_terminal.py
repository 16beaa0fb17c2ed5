"""The console in the terminal: keys that a person would press."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from live_helpers import PlantedShow, channels

pytest.importorskip("textual", reason="textual is not installed (extra 'ground')")

from textual.widgets import Sparkline, Static

from ground.live.playback import read_recorded
from ground.live.shows import RecordedShow
from ground.live.terminal import ConsoleApp, bar, belief_text


def text_of(app: ConsoleApp, name: str) -> str:
    return str(app.query_one(f"#{name}", Static).content)


def test_keys_send_commands_and_fire_takes_two() -> None:
    async def drive() -> None:
        show = PlantedShow()
        show.tell(channels("armed", 3.0, outputs__energy_used_j=4.0))
        app = ConsoleApp(show)
        async with app.run_test(size=(150, 45)) as pilot:
            assert "ARMED" in text_of(app, "banner") and "keep clear" in text_of(app, "banner")
            assert app.query_one("#banner").has_class("armed")
            await pilot.press("f")
            assert show.sent == []
            await pilot.press("f", "x", "t")
            assert show.sent == [("fire", {}), ("abort", {}), ("tension", {"energy_j": 18.0})]
            show.refusing = "ping: not sent: gone"
            await pilot.press("p")
            app.look()
            assert "ping: not sent: gone" in text_of(app, "answers")
            assert "4.0 J" in text_of(app, "spring")
            assert "force" in text_of(app, "force-title")

    asyncio.run(drive())


def test_a_recording_is_played_with_the_arrows(flown_log: Path) -> None:
    async def drive() -> None:
        recorded = read_recorded(flown_log)
        app = ConsoleApp(RecordedShow(recorded))
        async with app.run_test(size=(150, 45)) as pilot:
            await pilot.press("right", "right", "right", "left")
            assert app.at_s == recorded.start_s + 2.0
            app.at_s = recorded.end_s
            app.look()
            assert "SAFE" in text_of(app, "banner") and "stowed" in text_of(app, "banner")
            assert "quartz sand" in text_of(app, "belief")
            for name in ("compression", "current", "force"):
                assert "highest" in text_of(app, f"{name}-title")
                assert app.query_one(f"#plot-{name}", Sparkline).data

    asyncio.run(drive())


def test_bars_are_as_long_as_their_share() -> None:
    assert bar(0.5, 4) == "██░░"
    assert bar(7.0, 3) == "███"
    assert "no hop" in str(belief_text([]))
