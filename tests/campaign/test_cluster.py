"""Campaigns on a Dask cluster of real processes, one of which is killed in the middle."""

from __future__ import annotations

import asyncio
import os
import signal
import threading
import time
from collections.abc import Iterator
from concurrent.futures import CancelledError
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import sums
from sums import Sums, quiet

from ground.campaign.crews import Cluster, OneProcess, crew
from ground.campaign.engine import run_study
from ground.campaign.study import Answer, stamp_of
from hal.errors import ConfigError

distributed: Any = pytest.importorskip("distributed", reason="the extra `cluster` is not installed")
pytestmark = pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::DeprecationWarning")


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    """Three worker processes that can import the study."""
    paths = os.pathsep.join((str(Path(sums.__file__).parent), os.environ.get("PYTHONPATH", "")))
    before = os.environ.get("PYTHONPATH")
    os.environ["PYTHONPATH"] = paths
    try:
        made = distributed.LocalCluster(
            n_workers=3,
            threads_per_worker=2,
            processes=True,
            dashboard_address="127.0.0.1:0",
            silence_logs=50,
        )
    finally:
        if before is None:
            del os.environ["PYTHONPATH"]
        else:
            os.environ["PYTHONPATH"] = before
    with made:
        yield made.scheduler_address


def test_a_cluster_gives_the_same_even_when_a_worker_is_killed(address: str, tmp_path: Path) -> None:
    trace, killed = tmp_path / "trace", list[int]()

    def kill_one() -> None:
        """As soon as the campaign is under way, whoever is at work."""
        for _ in range(1000):
            lines = trace.read_text(encoding="utf-8").splitlines() if trace.exists() else []
            if len(lines) > 20:
                killed.append(int(lines[-1].split()[0]))
                os.kill(killed[0], signal.SIGKILL)
                return
            time.sleep(0.01)

    killer = threading.Thread(target=kill_one)
    killer.start()
    with crew(1, address) as workers:
        assert workers.workers() == 3
        study = Sums(1, trace=str(trace), wait_s=0.03)
        result = run_study(study, 80, tmp_path / "cluster", workers, quiet)
    killer.join()
    workers_seen = {line.split()[0] for line in trace.read_text(encoding="utf-8").splitlines()}
    assert killed and len(workers_seen) >= 3
    expected = run_study(Sums(1), 80, tmp_path / "alone", OneProcess(), quiet)
    assert (result.rows, result.failed) == (expected.rows, expected.failed)
    done = [int(line.split()[1]) for line in trace.read_text(encoding="utf-8").splitlines()]
    assert set(range(81)) <= set(done)


def test_an_answer_in_hand_counts_though_its_worker_is_lost_just_then(
    address: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    gather = distributed.Client._gather

    async def then_lose(self: Any, futures: list[Any], *others: Any, **named: Any) -> Any:
        answers = await gather(self, futures, *others, **named)
        for future in futures:
            future._state.lose()
        return answers

    monkeypatch.setattr(distributed.Client, "_gather", then_lose)
    with crew(1, address) as workers:
        result = run_study(Sums(1), 6, tmp_path, workers, quiet)
    assert len(result.rows) == 6


class Client:
    """Answers as told, as Dask's client would."""

    def __init__(self, loop: asyncio.AbstractEventLoop, *answers: BaseException | Answer) -> None:
        self._answers = list(answers)
        self.loop = SimpleNamespace(asyncio_loop=loop)

    async def submit(self, *work: object, pure: bool) -> Answer:
        assert not pure
        given = self._answers.pop(0)
        if isinstance(given, Answer):
            return given
        raise given


@pytest.fixture
def loop() -> Iterator[asyncio.AbstractEventLoop]:
    """One that runs in a thread of its own, as Dask's does."""
    made = asyncio.new_event_loop()
    thread = threading.Thread(target=made.run_forever)
    thread.start()
    yield made
    made.call_soon_threadsafe(made.stop)
    thread.join()
    made.close()


def test_a_case_whose_workers_died_is_sent_once_more_and_then_fails(loop: asyncio.AbstractEventLoop) -> None:
    killed, good = (
        distributed.KilledWorker("answer", "tcp://w:1", 3),
        Answer({"index": 3, "failed": None}, 0.1),
    )
    study, stamp = Sums(1), stamp_of(Sums(1))
    cluster = Cluster(Client(loop, killed, good, killed, killed))
    assert cluster.result(cluster.submit(study, 3, stamp), study, 3, stamp) == good
    failed = cluster.result(cluster.submit(study, 3, stamp), study, 3, stamp).row
    assert failed["index"] == 3
    assert "its process died each time, the last at tcp://w:1" in failed["failed"]


def test_a_lost_cluster_ends_the_campaign_with_words(loop: asyncio.AbstractEventLoop) -> None:
    study, stamp = Sums(1), stamp_of(Sums(1))
    cluster = Cluster(Client(loop, CancelledError()))
    with pytest.raises(ConfigError, match="the cluster was lost"):
        cluster.result(cluster.submit(study, 3, stamp), study, 3, stamp)


def test_a_real_cluster_that_forgets_the_campaign_is_told(address: str) -> None:
    study, stamp = Sums(1, wait_s=5.0), stamp_of(Sums(1))
    with crew(1, address) as workers, distributed.Client(address, set_as_default=False) as other:
        sent = workers.submit(study, 3, stamp)
        other.restart()
        with pytest.raises(ConfigError, match="the cluster was lost"):
            workers.result(sent, study, 3, stamp)


def test_workers_with_other_settings_are_refused(address: str, tmp_path: Path) -> None:
    with crew(1, address) as workers, pytest.raises(ConfigError, match="a worker has other settings"):
        run_study(OtherHere(1), 5, tmp_path, workers, quiet)


class OtherHere(Sums):
    """Its settings differ from process to process."""

    def settings(self) -> object:
        return os.getpid()


def test_no_cluster_there_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ground.campaign.crews.CONNECT_S", 0.3)
    told = r"--scheduler tcp://127\.0\.0\.1:9: no Dask scheduler answers"
    with pytest.raises(ConfigError, match=told), crew(1, "tcp://127.0.0.1:9"):
        pass
