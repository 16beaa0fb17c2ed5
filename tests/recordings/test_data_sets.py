"""Public data sets: fetched from a server of the test's own, checked, refused when they are something else."""

from __future__ import annotations

import functools
import hashlib
import threading
from collections.abc import Iterator
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest
import yaml

from ground.data_sets import FetchError, fetch, known_sets
from hal.config import config_root
from hal.errors import ConfigError

CONTENT = b"t,x\n0,1\n1,2\n"


class Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *_: object) -> None:
        """Nothing is logged."""


@pytest.fixture
def server(tmp_path: Path) -> Iterator[str]:
    folder = tmp_path / "served"
    folder.mkdir()
    (folder / "run.csv").write_bytes(CONTENT)
    running = ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=str(folder)))
    thread = threading.Thread(target=running.serve_forever)
    thread.start()
    yield f"http://127.0.0.1:{running.server_address[1]}"
    running.shutdown()
    thread.join()
    running.server_close()


def table(folder: Path, url: str, sha256: str | None = None, file: str = "run.csv") -> Path:
    checksum = sha256 or hashlib.sha256(CONTENT).hexdigest()
    content = {
        "format": 1,
        "data_sets": {
            "press": {
                "title": "a press",
                "licence": "CC0-1.0",
                "files": {file: {"url": url, "sha256": checksum}},
            }
        },
    }
    path = folder / "table.yaml"
    path.write_text(yaml.safe_dump(content))
    return path


def test_a_data_set_is_fetched_checked_and_kept(server: str, tmp_path: Path) -> None:
    listed = table(tmp_path, f"{server}/run.csv")
    (path,) = fetch("press", tmp_path / "here", listed)
    assert path.read_bytes() == CONTENT
    unreachable = table(tmp_path, "http://127.0.0.1:9/run.csv")
    assert fetch("press", tmp_path / "here", unreachable) == [path]  # it is there already


def test_another_file_is_refused_and_not_kept(server: str, tmp_path: Path) -> None:
    with pytest.raises(FetchError, match=r"run\.csv: is not the file that the table knows"):
        fetch("press", tmp_path / "here", table(tmp_path, f"{server}/run.csv", "0" * 64))
    assert not (tmp_path / "here" / "run.csv").exists()


@pytest.mark.parametrize("address", ["{server}/none.csv", "http://127.0.0.1:9/run.csv"])
def test_what_cannot_be_had_is_said_with_its_address(server: str, tmp_path: Path, address: str) -> None:
    with pytest.raises(FetchError, match="cannot be fetched"):
        fetch("press", tmp_path / "here", table(tmp_path, address.format(server=server)))


def test_faulty_tables_and_unknown_names_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"'pres' is not known; known: press"):
        fetch("pres", tmp_path, table(tmp_path, "http://x/run.csv"))
    with pytest.raises(ConfigError, match=r"sha256 is no SHA-256"):
        known_sets(table(tmp_path, "http://x/run.csv", "abc"))
    with pytest.raises(ConfigError, match="a plain file name is needed"):
        known_sets(table(tmp_path, "http://x/run.csv", file="../run.csv"))


def test_our_table_is_sound() -> None:
    for name, one in known_sets().items():
        assert one.licence, name
        assert all(remote.url.startswith("https://") for remote in one.files.values())
        assert one.import_with is None or (config_root() / "imports" / f"{one.import_with}.yaml").is_file()
