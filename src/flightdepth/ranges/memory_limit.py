"""Fewer frame pairs where the network's device has no memory for all, and then the CPU."""

from __future__ import annotations

import logging
from collections.abc import Callable

from flightdepth.ranges.network import DepthNetwork, Movable
from flightdepth.ranges.pairs import Pair
from flightdepth.runtimes.memory import OutOfMemory
from flightdepth.runtimes.prediction import Prediction

logger = logging.getLogger(__name__)

Pairs = tuple[Pair, ...]


class MemoryLimit:
    """What a flight has learnt of the device's memory: `most_pairs` at once, and `notes` for who reads the result."""

    def __init__(self, most_pairs: int) -> None:
        self.most_pairs = self._without_limit = most_pairs
        self.notes: tuple[str, ...] = ()

    def predicted(
        self, pairs: Pairs, network: DepthNetwork, predict: Callable[[Pairs], Prediction]
    ) -> tuple[Pairs, Prediction]:
        """The pairs that there was memory for, at least one, and what `predict` says of them."""
        while True:
            try:
                return pairs, predict(pairs)
            except OutOfMemory as error:
                if len(pairs) > 1:
                    pairs = pairs[:-1]
                    self._give_up(error, len(pairs), f"at most {len(pairs)} of a frame's pairs")
                elif isinstance(network, Movable) and network.move_to_cpu():
                    self._give_up(error, self._without_limit, "on the CPU")
                else:
                    raise

    def _give_up(self, error: OutOfMemory, most: int, what: str) -> None:
        if not self.notes:
            logger.warning("%s: going on with fewer frame pairs, in the end on the CPU", error)
        self.most_pairs, self.notes = most, (f"{error}: after that {what}",)
