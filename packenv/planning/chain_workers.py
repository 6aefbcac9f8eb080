"""Chains on worker processes: the same rounds, told in the same order, as in one process."""

from __future__ import annotations

import multiprocessing
import pickle
import signal
from collections.abc import Iterator, Mapping, Sequence
from multiprocessing.connection import Connection
from typing import Protocol

from packenv.planning.chains import Chain, Improvement, Round, RoundEnd


class Team(Protocol):
    """Chains, wherever they are."""

    def __enter__(self) -> Team:
        """The team."""
        ...

    def __exit__(self, *_: object) -> None:
        """Free what it holds."""
        ...

    def advance(self, tasks: Sequence[Round]) -> Iterator[tuple[int, Improvement | RoundEnd]]:
        """What the chains, by number, tell of a round: all of the first one, then all of the second one.

        Who does not listen to the end gives the others' round up.
        """
        ...


class OneProcess:
    """Chains in this process, one after another."""

    def __init__(self, chains: Sequence[Chain]) -> None:
        """Take the chains."""
        self.chains = chains

    def __enter__(self) -> OneProcess:
        """The team."""
        return self

    def __exit__(self, *_: object) -> None:
        """Nothing to free."""

    def advance(self, tasks: Sequence[Round]) -> Iterator[tuple[int, Improvement | RoundEnd]]:
        """See :meth:`Team.advance`."""
        for k, (chain, task) in enumerate(zip(self.chains, tasks, strict=True)):
            for told in chain.advance(task):
                yield k, told


class Processes:
    """Chains on worker processes, each always on the same one.

    The processes are started anew, not forked, for what has threads does not survive a fork. So a script that asks
    for workers keeps its work under ``if __name__ == "__main__":``, as :mod:`multiprocessing` wants it.
    """

    def __init__(self, chains: Sequence[Chain], workers: int) -> None:
        """Start the processes.

        Args:
            chains: they are copied.
            workers: how many processes.

        Raises:
            TypeError: something of the chains cannot be copied to another process, such as a heuristic that is a
                lambda.
        """
        context = multiprocessing.get_context("spawn")
        self._count = min(workers, len(chains))
        shares = [dict(list(enumerate(chains))[w :: self._count]) for w in range(self._count)]
        try:
            texts = [pickle.dumps(share) for share in shares]
        except (pickle.PicklingError, AttributeError, TypeError) as problem:
            raise TypeError(str(problem)) from problem
        self._connections: list[Connection] = []
        self._processes = []
        for text in texts:
            here, there = context.Pipe()
            process = context.Process(target=_work, args=(text, there), daemon=True)
            process.start()
            there.close()
            self._connections.append(here)
            self._processes.append(process)

    def __enter__(self) -> Processes:
        """The team."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the processes, whatever they do."""
        for process in self._processes:
            process.terminate()
        for process, connection in zip(self._processes, self._connections, strict=True):
            process.join()
            connection.close()

    def advance(self, tasks: Sequence[Round]) -> Iterator[tuple[int, Improvement | RoundEnd]]:
        """See :meth:`Team.advance`.

        Raises:
            ChildProcessError: a process has ended by itself.
        """
        try:
            for k, task in enumerate(tasks):
                self._connections[k % self._count].send((k, task))
            for k in range(len(tasks)):
                told: Improvement | RoundEnd | None = None
                while not isinstance(told, RoundEnd):
                    told = self._connections[k % self._count].recv()
                    yield k, told
        except (EOFError, ConnectionError):
            raise ChildProcessError("a worker process has ended by itself") from None


def _work(text: bytes, connection: Connection) -> None:
    """What a process does: chains by number, one round after another."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the process that collects
    chains: Mapping[int, Chain] = pickle.loads(text)
    while True:
        try:
            k, task = connection.recv()
        except EOFError:
            return
        for told in chains[k].advance(task):
            connection.send(told)
