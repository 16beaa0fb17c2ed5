"""The page is for its own reader: token, own address, own origin, and nothing else."""

from __future__ import annotations

import http.client
import json
from collections.abc import Iterator

import pytest
from live_helpers import PlantedShow, channels

from ground.live.server import HOST, ConsoleServer


@pytest.fixture
def server() -> Iterator[ConsoleServer]:
    show = PlantedShow()
    show.tell(channels("hold", 5.0))
    with ConsoleServer(show) as running:
        yield running


def ask(
    server: ConsoleServer, path: str, method: str = "GET", body: str = "", **headers: str
) -> tuple[int, http.client.HTTPMessage, bytes]:
    connection = http.client.HTTPConnection(HOST, server.server_port, timeout=10)
    connection.request(method, path, body or None, {k.replace("_", "-"): v for k, v in headers.items()})
    answer = connection.getresponse()
    content = answer.read()
    connection.close()
    return answer.status, answer.headers, content


def cookie(server: ConsoleServer) -> str:
    return f"hopper_console={server.token}"


def origin(server: ConsoleServer) -> str:
    return f"http://{HOST}:{server.server_port}"


def test_it_listens_on_the_loopback_address_only(server: ConsoleServer) -> None:
    assert server.server_address[0] == "127.0.0.1"


def test_the_token_becomes_a_cookie_that_opens_the_page(server: ConsoleServer) -> None:
    status, headers, _ = ask(server, server.address.removeprefix(origin(server)))
    assert (status, headers["Location"]) == (303, "/")
    given = headers["Set-Cookie"]
    assert "HttpOnly" in given and "SameSite=Strict" in given
    status, headers, page = ask(server, "/", Cookie=given.partition(";")[0])
    assert status == 200 and b"hopper console" in page
    assert "default-src 'self'" in headers["Content-Security-Policy"]


@pytest.mark.parametrize("path", ["/", "/state", "/stream", "/plotly.js", "/console.js", "/nonesuch"])
def test_without_the_token_there_is_nothing_to_see(server: ConsoleServer, path: str) -> None:
    assert ask(server, path)[0] == 403
    assert ask(server, path, Cookie="hopper_console=guess")[0] == 403


def test_a_wrong_token_is_refused(server: ConsoleServer) -> None:
    assert ask(server, "/?token=guess")[0] == 403


def test_another_hosts_name_is_refused_even_with_the_token(server: ConsoleServer) -> None:
    for host in ("evil.example", f"evil.example:{server.server_port}", HOST):
        assert ask(server, "/state", Cookie=cookie(server), Host=host)[0] == 403


def test_the_state_is_what_the_robot_told(server: ConsoleServer) -> None:
    status, _, content = ask(server, "/state?after=4", Cookie=cookie(server))
    state = json.loads(content)
    assert (status, state["phase"], len(state["samples"])) == (200, "hold", 1)


def test_a_time_that_is_no_number_is_refused(server: ConsoleServer) -> None:
    assert ask(server, "/state?at=noon", Cookie=cookie(server))[0] == 400
    assert ask(server, "/series", Cookie=cookie(server))[0] == 400


def test_a_command_passes_from_the_own_page_only(server: ConsoleServer) -> None:
    body = json.dumps({"name": "tension", "arguments": {"energy_j": 5}})
    show = server.show
    assert isinstance(show, PlantedShow)
    for headers in (
        {},
        {"Cookie": cookie(server)},
        {"Cookie": cookie(server), "Origin": "http://evil.example"},
        {"Origin": origin(server)},
    ):
        assert ask(server, "/command", "POST", body, **headers)[0] == 403
    assert show.sent == []
    status, _, content = ask(server, "/command", "POST", body, Cookie=cookie(server), Origin=origin(server))
    assert (status, json.loads(content)["sent"]) == (200, True)
    assert show.sent == [("tension", {"energy_j": 5.0})]


def test_a_command_that_cannot_be_sent_says_why(server: ConsoleServer) -> None:
    assert isinstance(server.show, PlantedShow)
    server.show.refusing = "arm: not sent: the mission is over"
    body = json.dumps({"name": "arm", "arguments": {}})
    status, _, content = ask(server, "/command", "POST", body, Cookie=cookie(server), Origin=origin(server))
    assert (status, json.loads(content)["why"]) == (409, "arm: not sent: the mission is over")


@pytest.mark.parametrize(
    "body", ["", "{", "[]", '{"name": "arm"}', '{"name": "arm", "arguments": {"a": "b"}}', "x" * 5000]
)
def test_what_is_no_command_is_refused(server: ConsoleServer, body: str) -> None:
    assert ask(server, "/command", "POST", body, Cookie=cookie(server), Origin=origin(server))[0] == 400


def test_nothing_of_the_page_comes_from_the_network(server: ConsoleServer) -> None:
    for path in ("/", "/console.js", "/plots.js", "/console.css"):
        content = ask(server, path, Cookie=cookie(server))[2]
        assert b"http://" not in content and b"https://" not in content
