"""Whole pictures out of interlaced ones, as analogue cameras and their capture cards send them.

Of an interlaced picture every second line was taken half a picture's time later: what moves is torn like a comb, and
how far it moved is what depth is made from. The lines of the first field stay, FFmpeg's bwdif fills in the others.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from fractions import Fraction
from typing import Any

from av.error import BlockingIOError, EOFError
from av.filter import Graph

# One picture out of one; those that are not interlaced go through as they are.
FILTER = "mode=send_frame:deint=interlaced"


class Deinterlacer:
    """Decoded pictures in, as many out; from the first interlaced one on each comes when the next one does."""

    def __init__(self) -> None:
        self._graph: Graph | None = None
        self._shape: tuple[int, int, str] | None = None
        self._time_base = Fraction(1)

    def add(self, picture: Any) -> Iterator[Any]:
        """The pictures that are ready when this one came."""
        shape = (picture.width, picture.height, picture.format.name)
        if self._graph is not None and shape != self._shape:
            yield from self.flush()
        if self._graph is None and not picture.interlaced_frame:
            yield picture
            return
        if self._graph is None:
            self._graph, self._shape, self._time_base = _graph(picture), shape, picture.time_base
        self._graph.push(picture)
        yield from self._ready(self._graph)

    def flush(self) -> Iterator[Any]:
        """The picture that waits for the next one, which will not come."""
        graph, self._graph = self._graph, None
        if graph is not None:
            graph.push(None)
            yield from self._ready(graph)

    def _ready(self, graph: Graph) -> Iterator[Any]:
        while True:
            try:
                picture: Any = graph.pull()
            except (BlockingIOError, EOFError):
                return
            if picture.pts is not None:  # bwdif counts in half ticks
                picture.pts = round(picture.pts * picture.time_base / self._time_base)
            picture.time_base = self._time_base
            yield picture


def deinterlaced(pictures: Iterable[tuple[Any, bool]]) -> Iterator[tuple[Any, bool]]:
    """All of a file's pictures, each with what is said beside it."""
    deinterlacer = Deinterlacer()
    beside: deque[bool] = deque()
    for picture, said in pictures:
        beside.append(said)
        for ready in deinterlacer.add(picture):
            yield ready, beside.popleft()
    for ready in deinterlacer.flush():
        yield ready, beside.popleft()


def _graph(picture: Any) -> Graph:
    graph = Graph()
    source = graph.add_buffer(
        width=picture.width, height=picture.height, format=picture.format, time_base=picture.time_base
    )
    filled, sink = graph.add("bwdif", FILTER), graph.add("buffersink")
    source.link_to(filled)
    filled.link_to(sink)
    graph.configure()
    return graph
