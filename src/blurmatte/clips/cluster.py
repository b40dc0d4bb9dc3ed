"""Workers on many machines: the cluster of a Dask scheduler."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from blurmatte.errors import BlurmatteError
from blurmatte.motion import Workers

RETRIES = 2  # of a task whose worker is lost


@contextmanager
def cluster_workers(scheduler: Any, folder: str | Path) -> Iterator[Workers]:
    """The workers of a Dask cluster; needs the `cluster` extra.

    Parameters
    ----------
    scheduler : str or distributed.Client
        Its address, such as "tcp://host:8786", or a client, which stays open.
    folder : str or Path
        On a disk that all machines reach by the same path; inputs and results are there, too.

    Raises
    ------
    BlurmatteError
        If `distributed` is not installed.
    ValueError
        If the cluster has no workers.

    Examples
    --------
    >>> from distributed import Client  # doctest: +SKIP
    >>> client = Client("tcp://host:8786")  # doctest: +SKIP
    >>> with bm.clips.cluster_workers(client, "/shared/rally") as workers:  # doctest: +SKIP
    ...     events = list(bm.save_clip(run, "/shared/rally", workers))
    """
    try:
        from distributed import Client
    except ImportError as error:
        raise BlurmatteError("a cluster needs: pip install 'blurmatte[cluster]'") from error
    client = scheduler if isinstance(scheduler, Client) else Client(scheduler)
    try:
        threads = sum(client.nthreads().values())
        if threads == 0:
            raise ValueError(f"the scheduler {scheduler} has no workers; start some: dask worker")
        Path(folder).mkdir(parents=True, exist_ok=True)
        executor = client.get_executor(retries=RETRIES)
        with Workers(threads, executor, folder) as workers:
            yield workers
    finally:
        if client is not scheduler:
            client.close()
