"""The page in headless Chromium: what a person would see and click."""

from __future__ import annotations

from pathlib import Path

from live_helpers import PlantedShow, browser_page, channels

from ground.live.playback import read_recorded
from ground.live.server import ConsoleServer
from ground.live.shows import RecordedShow
from ground.live.view import Told


def test_a_live_robot_is_shown_and_commanded() -> None:
    show = PlantedShow()
    show.tell(
        channels(
            "hold", 3.0, outputs__energy_used_j=12.5, outputs__string_force_n=700.0, outputs__loaded=True
        )
    )
    with ConsoleServer(show) as server, browser_page() as page:
        page.goto(server.address)
        page.wait_for_selector("#phase:has-text('HOLD')")
        assert "token" not in page.url
        assert page.inner_text("#energy").startswith("12.50 J")
        assert page.inner_text("#danger") == "The spring may hold energy."
        assert page.inner_text("#states [aria-current]").strip().startswith("hold")
        assert "would be refused: not accepted in hold" in page.inner_text("#command-fire")
        page.fill("input[name=energy_j]", "7.5")
        page.click("button.tension")
        page.click("button.arm")
        page.wait_for_selector("#plot-compression.js-plotly-plot")
        assert show.sent == [("tension", {"energy_j": 7.5}), ("arm", {})]
        refused = {"name": "command_refused", "severity": "warning", "command": "tension", "phase": "hold"}
        show.tell(Told(None, "acknowledgement", {**refused, "time_s": 3.5, "why": ["not accepted in hold"]}))
        page.wait_for_selector("#answers li.refused:has-text('refused in hold: not accepted in hold')")

        show.tell(channels("armed", 4.0, outputs__energy_used_j=12.5, outputs__loaded=True))
        page.wait_for_selector("body.armed")
        assert "ARMED: keep clear" in page.inner_text("#danger")
        assert "ARMED" in page.title()


def test_firing_takes_two_presses_and_the_keyboard_is_enough() -> None:
    show = PlantedShow()
    show.tell(channels("armed", 3.0))
    with ConsoleServer(show) as server, browser_page() as page:
        page.goto(server.address)
        page.wait_for_selector("button.fire")
        page.focus("button.arm")
        page.keyboard.press("Tab")
        assert page.evaluate("document.activeElement.className") == "fire"
        page.keyboard.press("Enter")
        assert show.sent == []
        page.keyboard.press("Enter")
        page.keyboard.press("x")
        page.wait_for_timeout(300)
        assert show.sent == [("fire", {}), ("abort", {})]
        show.refusing = "ping: not sent: the link is lost"
        page.click("button.ping")
        page.wait_for_selector("#status:has-text('ping: not sent: the link is lost')")


def test_it_fits_a_phone() -> None:
    show = PlantedShow()
    show.tell(channels("tensioning", 3.0))
    with ConsoleServer(show) as server, browser_page(width=360, height=740) as page:
        page.goto(server.address)
        page.wait_for_selector("#phase:has-text('TENSIONING')")
        page.wait_for_timeout(500)
        assert page.evaluate("document.documentElement.scrollWidth") <= 360


def test_a_log_is_played_back(flown_log: Path) -> None:
    recorded = read_recorded(flown_log)
    fire_s = next(m.time_s or 0.0 for m in recorded.told if m.payload.get("to") == "armed")
    with ConsoleServer(RecordedShow(recorded)) as server, browser_page() as page:
        page.goto(server.address)
        page.wait_for_selector("#player:not([hidden])")
        page.wait_for_selector("#plot-force.js-plotly-plot")
        page.evaluate(
            "t => { const s = document.getElementById('slider'); s.value = t; s.dispatchEvent(new Event('input')) }",
            fire_s + 0.1,
        )
        page.wait_for_selector("body.armed")
        page.focus("#slider")
        page.keyboard.press("End")
        page.wait_for_selector("#phase:has-text('SAFE')")
        assert "quartz sand" in page.inner_text("#plot-belief")
        assert page.locator("#hops tr").count() == 2
        page.keyboard.press("Home")
        page.click("#play")
        page.wait_for_selector("#clock:has-text('t = 1.')")
        page.click("button.abort")
        page.wait_for_selector("#status:has-text('this is a recording')")
