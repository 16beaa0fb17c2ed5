"""Who does the work: this process, processes of this computer, or a Dask cluster."""

from __future__ import annotations

import asyncio
import multiprocessing
from collections.abc import Awaitable, Iterator
from concurrent.futures import CancelledError, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import Any, Protocol

from ground.campaign.study import Answer, OtherWorkerError, Study, answer, failed_row
from ground.pools import end_with_parent
from hal.errors import ConfigError

WAITING_BY_WORKER = 4
CONNECT_S = 10.0
DIED = "its process died"


class Crew(Protocol):
    """Does cases, several at a time."""

    def workers(self) -> int:
        """How many there are now."""

    def submit(self, study: Study, index: int, stamp: dict[str, Any]) -> Future[Answer]:
        """Have a case done."""

    def result(self, done: Future[Answer], study: Study, index: int, stamp: dict[str, Any]) -> Answer:
        """What came of a case that ended; one whose process dies with it fails. Raises `ConfigError`."""


class OneProcess:
    """This process itself."""

    def workers(self) -> int:
        """One."""
        return 1

    def submit(self, study: Study, index: int, stamp: dict[str, Any]) -> Future[Answer]:
        """Do the case at once."""
        done: Future[Answer] = Future()
        try:
            done.set_result(answer(study, index, stamp))
        except OtherWorkerError as error:
            done.set_exception(error)
        return done

    def result(self, done: Future[Answer], study: Study, index: int, stamp: dict[str, Any]) -> Answer:
        """The answer."""
        try:
            return done.result()
        except OtherWorkerError as error:  # settings or code were changed meanwhile
            raise ConfigError(str(error)) from error


class Processes:
    """Processes of this computer."""

    def __init__(self, number: int) -> None:
        self._number = number
        self._pool = _pool(number)

    def workers(self) -> int:
        """How many processes."""
        return self._number

    def submit(self, study: Study, index: int, stamp: dict[str, Any]) -> Future[Answer]:
        """Queue the case; after a process has died, in a new pool."""
        try:
            return self._pool.submit(answer, study, index, stamp)
        except BrokenProcessPool:
            self._pool = _pool(self._number)
            return self._pool.submit(answer, study, index, stamp)

    def result(self, done: Future[Answer], study: Study, index: int, stamp: dict[str, Any]) -> Answer:
        """The answer. A case that was in a pool when a process died is done again, alone: was it that one?"""
        try:
            return done.result()
        except BrokenProcessPool:
            return self._alone(study, index, stamp)
        except OtherWorkerError as error:
            raise ConfigError(str(error)) from error

    def _alone(self, study: Study, index: int, stamp: dict[str, Any]) -> Answer:
        with _pool(1) as pool:
            try:
                return pool.submit(answer, study, index, stamp).result()
            except BrokenProcessPool:
                return Answer(failed_row(index, DIED), 0.0)

    def stop(self) -> None:
        """Drop what waits; let what runs end by itself."""
        self._pool.shutdown(wait=False, cancel_futures=True)


class Cluster:
    """A Dask cluster; workers may come and go. What a lost worker had is done by another one."""

    def __init__(self, client: Any) -> None:
        self._client = client

    def workers(self) -> int:
        """How many worker processes there are now, at least one: the first may yet come."""
        return max(1, len(self._client.nthreads()))

    def submit(self, study: Study, index: int, stamp: dict[str, Any]) -> Future[Answer]:
        """Send the case to the cluster.

        Dask's own executor is not used: it looks at the state again once it has the answer, and fails when the
        worker was lost in between.
        """
        sent = self._client.submit(answer, study, index, stamp, pure=False)
        return asyncio.run_coroutine_threadsafe(_awaited(sent), self._client.loop.asyncio_loop)

    def result(self, done: Future[Answer], study: Study, index: int, stamp: dict[str, Any]) -> Answer:
        """The answer. A case with which worker after worker dies fails.

        The scheduler gives up every case that was with such workers. Each is therefore sent once more.
        """
        from distributed import KilledWorker

        try:
            try:
                return done.result()
            except KilledWorker:
                return self.submit(study, index, stamp).result()
        except KilledWorker as error:
            return Answer(failed_row(index, f"{DIED} each time, the last at {error.last_worker}"), 0.0)
        except (CancelledError, asyncio.CancelledError) as error:
            raise ConfigError("the cluster was lost; the same command goes on where it was") from error
        except OtherWorkerError as error:
            raise ConfigError(str(error)) from error


async def _awaited(sent: Awaitable[Answer]) -> Answer:
    return await sent


def _pool(number: int) -> ProcessPoolExecutor:
    return ProcessPoolExecutor(number, multiprocessing.get_context("spawn"), end_with_parent)


@contextmanager
def crew(processes: int, scheduler: str | None) -> Iterator[Crew]:
    """The crew asked for, for as long as the block lasts. Raises `ConfigError` when there is no such cluster."""
    if scheduler is not None:
        with _client(scheduler) as client:
            yield Cluster(client)
    elif processes == 1:
        yield OneProcess()
    else:
        many = Processes(processes)
        try:
            yield many
        finally:
            many.stop()


@contextmanager
def _client(address: str) -> Iterator[Any]:
    try:
        from distributed import Client
    except ImportError as error:
        raise ConfigError(
            "--scheduler needs Dask; install it with: pip install 'hopper-flight[cluster]'"
        ) from error
    try:
        client: Any = Client(address, timeout=CONNECT_S, set_as_default=False)  # type: ignore[no-untyped-call]
    except (OSError, ValueError) as error:
        raise ConfigError(f"--scheduler {address}: no Dask scheduler answers there ({error})") from error
    try:
        yield client
    finally:
        client.close()
