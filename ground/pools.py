"""Worker processes that never outlive what started them."""

from __future__ import annotations

import multiprocessing
import multiprocessing.connection
import os
import threading


def end_with_parent() -> None:
    """In a worker process: end at once when its parent is gone, even killed, when nobody can tell it to.

    Give it to a pool as its initializer. A worker in the middle of a job would otherwise go on until that is done,
    and then wait for ever.
    """
    parent = multiprocessing.parent_process()
    if parent is None:  # not a worker
        return

    def watch() -> None:
        multiprocessing.connection.wait([parent.sentinel])
        os._exit(1)  # not sys.exit: this is not the main thread, and there is nobody left to clean up for

    threading.Thread(target=watch, name="parent watch", daemon=True).start()
