"""Which messages of a recording were found, which were lost, and which are missing: each is told of once.

Containers write the same thing twice: an index behind each chunk says what the chunk held, one at the end
of the file how many messages there should be.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

from pipeline.formats.base import Loss

Key = TypeVar("Key", bound=int | str)


@dataclass(slots=True)
class _LostChunk:
    """A chunk that could not be read; the indexes behind it say what it held."""

    detail: str
    size: int
    indexed: bool = False


class Account(Generic[Key]):
    """The messages of a recording, by the key under which it counts them.

    Parameters
    ----------
    losses : list of Loss
        Where the losses go.
    topic_of : callable
        The topic of a key; "" where it is not known.
    """

    def __init__(self, losses: list[Loss], topic_of: Callable[[Key], str]) -> None:
        self._losses = losses
        self._topic_of = topic_of
        self._known: Counter[Key] = Counter()
        """Messages found, or lost and told of."""
        self._unusable: Counter[str] = Counter()
        self._lost: _LostChunk | None = None

    def found(self, key: Key, unusable: str = "") -> None:
        """A message was found; ``unusable`` says what is wrong with it and its like, if it is of no use."""
        self._known[key] += 1
        if unusable:
            self._unusable[unusable] += 1

    def lose_chunk(self, detail: str, size: int) -> None:
        """A chunk of ``size`` bytes cannot be read."""
        self._lost = _LostChunk(detail, size)

    @property
    def has_lost_chunk(self) -> bool:
        """Whether the chunk last met is lost, so that the indexes behind it are wanted."""
        return self._lost is not None

    def index(self, key: Key, times: Sequence[int]) -> None:
        """An index behind the lost chunk has messages of these log times [ns]."""
        assert self._lost is not None
        start, end = min(times, default=None), max(times, default=None)
        self._losses.append(Loss(self._topic_of(key), self._lost.detail, len(times), "messages", start, end))
        self._known[key] += len(times)
        self._lost.indexed = True

    def close_chunk(self) -> None:
        """No further index of the chunk follows; of a lost one without any, only the size is known."""
        if self._lost is not None and not self._lost.indexed:
            self._losses.append(Loss("", self._lost.detail, self._lost.size, "bytes"))
        self._lost = None

    def close(self, counts: Mapping[Key, int], source: str) -> None:
        """The recording is at its end; compare with the counts that ``source`` has."""
        self._losses += [Loss("", detail, count, "messages") for detail, count in self._unusable.items()]
        for key, count in counts.items():
            missing = count - self._known[key]
            if missing > 0:
                detail = f"{source} counts {count} messages, {count - missing} were found"
                self._losses.append(Loss(self._topic_of(key), detail, missing, "messages"))
