"""The console in the terminal: the same view, the same commands, by Textual."""

from __future__ import annotations

import math
from typing import Any

from rich.text import Text
from textual.app import App, ComposeResult
from textual.binding import Binding
from textual.containers import Horizontal, Vertical, VerticalScroll
from textual.timer import Timer
from textual.widgets import Footer, Input, Sparkline, Static

from ground.live.server import Show
from ground.live.sources import ConsoleError

PERIOD_S = 0.2
SURE_S = 3.0
BAR = 24
SIGNS = {"info": "i", "warning": "▲", "fault": "■"}
STYLES = {"info": "", "warning": "yellow", "fault": "bold red"}
PLOTS = (
    ("compression", 1, "compression_m", 1e3, "mm"),
    ("current", 2, "current_a", 1.0, "A"),
    ("force", 4, "force_m_s2", 1.0, "m/s²"),
)
"""Name, column of the live samples, recorded line, scale, unit."""
SHOWN_S = 60.0


class ConsoleApp(App[None]):
    """One screen; `show` is what the browser's page would show."""

    CSS = """
    #banner { height: 3; padding: 0 1; border: round $secondary; }
    #banner.loaded { border: round yellow; }
    #banner.armed { border: heavy red; background: red; color: white; text-style: bold; }
    #left, #middle, #right { width: 1fr; padding: 0 1; }
    Sparkline { height: 3; margin-bottom: 1; }
    #energy { width: 100%; height: 3; }
    .title { text-style: bold; color: $accent; }
    """
    BINDINGS = [  # noqa: RUF012 (the way of the library)
        Binding("t", "send('tension')", "tension"),
        Binding("a", "send('arm')", "arm"),
        Binding("f", "send('fire')", "fire"),
        Binding("d", "send('de_tension')", "de-tension"),
        Binding("s", "send('stow')", "stow"),
        Binding("x", "send('abort')", "ABORT"),
        Binding("r", "send('reset')", "reset"),
        Binding("p", "send('ping')", "ping"),
        Binding("space", "play", "play"),
        Binding("left", "seek(-1.0)", "1 s back", show=False),
        Binding("right", "seek(1.0)", "1 s on", show=False),
        Binding("q", "quit", "quit"),
    ]

    def __init__(self, show: Show) -> None:
        super().__init__()
        self._show, self._about = show, show.about()
        self.at_s: float | None = None if self._about["live"] else self._about["start_s"]
        self._samples: list[list[float | None]] = []
        self._message = ""
        self._sure: Timer | None = None
        self._playing = False

    def compose(self) -> ComposeResult:
        """Banner; three columns; keys."""
        yield Static(id="banner")
        with Horizontal():
            with Vertical(id="left"):
                yield Static("spring", classes="title")
                yield Static(id="spring")
                for name, *_, unit in PLOTS:
                    yield Static(f"{name} [{unit}]", id=f"{name}-title", classes="title", markup=False)
                    yield Sparkline([], id=f"plot-{name}", summary_function=max)
            with Vertical(id="middle"):
                yield Static("what it believes to stand on", classes="title")
                yield Static(id="belief")
                yield Static("hops", classes="title")
                yield Static(id="hops")
                yield Static("decisions", classes="title")
                yield Static(id="decisions")
            with VerticalScroll(id="right"):
                yield Static("energy of the next tension command [J]", classes="title", markup=False)
                yield Input("18", id="energy", type="number")
                yield Static("answers", classes="title")
                yield Static(id="answers")
                yield Static("events", classes="title")
                yield Static(id="events")
        yield Footer()

    def on_mount(self) -> None:
        """Start looking."""
        self.title = f"hopper {self._about['title']}"
        self.set_focus(None)
        self.set_interval(PERIOD_S, self.look)
        self.look()

    def look(self) -> None:
        """Ask for the state and show it."""
        if not self.query("#banner"):  # a last beat of the timer while the screen is taken down
            return
        if self.at_s is None:
            after_s = self._samples[-1][0] if self._samples else None
            state = self._show.content({"after": -1.0 if after_s is None else after_s})
            self._samples = [*self._samples, *state["samples"]][-600:]
        else:
            if self._playing:
                self.action_seek(PERIOD_S)
            state = self._show.content({"at": self.at_s})
        self._show_banner(state)
        self._put("spring", spring_text(state, self._about["limits"]))
        self._put("belief", belief_text(state["hops"]))
        self._put("hops", hops_text(state["hops"]))
        self._put("decisions", decisions_text(state["decisions"]))
        self._put("answers", answers_text(state["answers"], self._message))
        self._put("events", events_text(state["events"], self._about["words"]))
        self._plot()

    def action_send(self, name: str) -> None:
        """Send a command; firing takes the key twice within three seconds."""
        if name == "fire" and self._sure is None:
            self._message = "fire: press f again within 3 s"
            self._sure = self.set_timer(SURE_S, self._unsure)
            return
        self._unsure()
        arguments = {"energy_j": self._energy_j()} if name == "tension" else {}
        try:
            self._show.command(name, arguments)
            self._message = f"{name}: sent"
        except ConsoleError as error:
            self._message = str(error)

    def action_play(self) -> None:
        """Play or pause a recording."""
        self._playing = not self._playing and self.at_s is not None

    def action_seek(self, by_s: float) -> None:
        """Go to another time of a recording."""
        if self.at_s is not None:
            self.at_s = min(max(self.at_s + by_s, self._about["start_s"]), self._about["end_s"])

    def on_input_submitted(self) -> None:
        """Back to the keys."""
        self.set_focus(None)

    def _unsure(self) -> None:
        if self._sure is not None:
            self._sure.stop()
        self._sure, self._message = None, ""

    def _energy_j(self) -> float:
        try:
            return float(self.query_one("#energy", Input).value)
        except ValueError:
            return math.nan  # the robot says why it is refused

    def _put(self, name: str, text: Text) -> None:
        self.query_one(f"#{name}", Static).update(text)

    def _show_banner(self, state: dict[str, Any]) -> None:
        phase = state["phase"].replace("_", " ").upper() or "NOT HEARD YET"
        danger = ""
        if state["armed"]:
            danger = "  ⚠ ARMED: keep clear, the spring can let go at any moment"
        elif state["loaded"] and state["phase"]:
            danger = "  the spring may hold energy"
        reason = f"  reason: {state['reason']}" if state["reason"] else ""
        text = f"{phase} for {state['in_phase_s']:.1f} s{danger}{reason}   t = {state['time_s']:.1f} s"
        banner = self.query_one("#banner", Static)
        banner.update(Text(f"{text}  {state['status']}", no_wrap=True))
        banner.set_class(state["armed"], "armed")
        banner.set_class(bool(state["loaded"] and not state["armed"]), "loaded")

    def _plot(self) -> None:
        series = None if self.at_s is None else self._show.series(max(0.0, self.at_s - SHOWN_S), self.at_s)
        for name, column, line, scale, unit in PLOTS:
            live = [row[column] for row in self._samples[-300:]]
            found = live if series is None else series[line]["v"]
            values = [scale * value for value in found if value is not None]
            self.query_one(f"#plot-{name}", Sparkline).data = values
            newest = f"{values[-1]:.2f}, highest {max(values):.2f}" if values else "–"
            self.query_one(f"#{name}-title", Static).update(f"{name} {newest} {unit}")


def bar(share: float, width: int = BAR) -> str:
    """A bar of so much of its width."""
    filled = round(width * min(1.0, max(0.0, share)))
    return "█" * filled + "░" * (width - filled)


def spring_text(state: dict[str, Any], limits: dict[str, Any]) -> Text:
    """Energy and force as gauges."""
    channels = state["channels"]
    lines = []
    for name, key, most, unit in (
        ("energy", "outputs.energy_used_j", limits["energy_j"], "J"),
        ("force ", "outputs.string_force_n", limits["force_n"], "N"),
    ):
        value = channels.get(key)
        shown = "–" if value is None else f"{value:7.1f} {unit}"
        lines.append(f"{name} {bar((value or 0.0) / most)} {shown}")
    return Text("\n".join(lines))


def belief_text(hops: list[dict[str, Any]]) -> Text:
    """The newest belief as bars, and how it went over the hops."""
    known = [hop for hop in hops if hop["belief"]]
    if not known:
        return Text("no hop on unknown ground yet", style="dim")
    lines = []
    for name, share in known[-1]["belief"]["surfaces"].items():
        past = "".join(" ▁▂▃▄▅▆▇█"[round(8 * hop["belief"]["surfaces"].get(name, 0.0))] for hop in known)
        lines.append(f"{name.replace('_', ' '):18} {bar(share, 12)} {100 * share:3.0f} %  {past}")
    return Text("\n".join(lines))


def hops_text(hops: list[dict[str, Any]]) -> Text:
    """One line for each of the newest hops."""

    def said(hop: dict[str, Any], key: str, scale: float) -> str:
        found = hop[key]
        return "–" if found is None else f"{scale * found['value']:.1f} ± {scale * found['sigma']:.1f}"

    lines = [
        f"{hop['hop_index'] + 1} {hop['place']}: {hop['verdict']}, {said(hop, 'energy_used_j', 1.0)} J, "
        f"{said(hop, 'height_m', 1e3)} mm, C3 {said(hop, 'c3', 100.0)} %"
        for hop in hops[-6:]
    ]
    return Text("\n".join(lines) or "none yet")


def decisions_text(decisions: list[dict[str, Any]]) -> Text:
    """The newest decisions in words."""
    return Text("\n".join(f"hop {d['hop_index'] + 1}: {d['sentence']}" for d in decisions[-4:]) or "none yet")


def answers_text(answers: list[dict[str, Any]], message: str) -> Text:
    """What was answered last, refusals standing out."""
    text = Text(f"{message}\n" if message else "", style="bold")
    for answer in reversed(answers[-5:]):
        text.append(f"{answer['time_s']:.1f} s {answer['words']}\n", "yellow" if answer.get("why") else "")
    return text


def events_text(events: list[dict[str, Any]], words: dict[str, str]) -> Text:
    """The newest events with sign and severity."""
    text = Text()
    for event in reversed(events[-12:]):
        severity = event["severity"]
        reason = f": {event['reason']}" if "reason" in event else ""
        said = words.get(event["name"], event["name"])
        text.append(
            f"{SIGNS[severity]} {severity} {event['time_s']:.1f} s {said}{reason}\n", STYLES[severity]
        )
    return text


def run_terminal(show: Show) -> None:
    """Show it until the person quits."""
    ConsoleApp(show).run()
