"""A page that is served, fed with results of a wall that comes nearer."""

from __future__ import annotations

import numpy as np
from obstacle_worlds import CAMERA, SIGHT, camera_attitude, result, wall

from flightdepth.flight.turn_verdict import TurnVerdict
from flightdepth.live.motion_store import MotionAt
from flightdepth.live.obstacle_memory import ObstacleMap
from flightdepth.live.obstacle_messages import ObstaclePacker
from flightdepth.live.obstacle_sender import ObstacleFeed
from flightdepth.live.obstacles import ObstacleSettings
from flightdepth.live.page import Page, PageServer
from flightdepth.live.status import FrameCounts, Health, LiveResult, LiveStatus, SinkCounts, State

WIDTH, HEIGHT = CAMERA.width, CAMERA.height


class Flying:
    """A server on a free port; `fly` gives the next result, a tenth of a second later."""

    def __init__(self) -> None:
        self.clock_ns = 1_000_000_000
        self.step = 0
        self.health = Health(State.OK, None, 0)
        self.distrusted: str | None = None
        self.lens: TurnVerdict | None = None
        self.dropped = {"a newer one came first": 2}
        self.feed = ObstacleFeed(ObstacleMap(lambda _: SIGHT), ObstaclePacker(ObstacleSettings()))
        self.page = Page(self.status, self.feed)
        self.server = PageServer(self.page, "127.0.0.1:0")

    def __enter__(self) -> Flying:
        self.server.start()
        return self

    def __exit__(self, *error: object) -> None:
        self.server.close()

    @staticmethod
    def still() -> LiveStatus:
        """A state without any result."""
        return LiveStatus(0, Health(State.LOST, "no stream yet", 0))

    def status(self) -> LiveStatus:
        """The engine now."""
        return LiveStatus(
            stamp_ns=self.clock_ns,
            health=self.health,
            age_ms=40.0,
            age_p95_ms=52.0,
            distrusted=self.distrusted,
            lens=self.lens,
            frames=FrameCounts(100 + self.step, 98 + self.step, self.dropped),
            ranges=2,
            shifts=(3, 12),
            displacements_m=(0.31, 1.42),
            fps_in=30.0,
            fps=29.4,
            telemetry_hz=30.0,
            telemetry_age_ms=14.0,
            uptime_s=self.clock_ns / 1e9,
            sinks={"page": SinkCounts(self.step, 0, 0)},
        )

    def fly(self) -> None:
        """A wall on the right, from 20 m down to 5; on the left nothing within 100 m."""
        self.step += 1
        self.clock_ns += 100_000_000
        depth = wall(camera_attitude(), max(5.0, 20.0 - 0.5 * self.step))
        depth[:, : WIDTH // 2] = 90.0
        image = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
        image[:, (7 * self.step) % WIDTH :] = (90, 130, 170)
        made = LiveResult(
            depth=result(depth),
            image=image,
            camera=CAMERA,
            stamp_ns=self.clock_ns - 40_000_000,
            ready_ns=self.clock_ns,
            boot_ns=None,
            motion=MotionAt(
                camera_attitude(),
                np.array([1.0, 0.0, 0.0, 0.0]),
                np.array([0.0, 3.0, 0.0]),
                None,
                self.clock_ns - 40_000_000,
            ),
            status=self.status(),
        )
        self.feed.take(made)
        self.page.take(made)


def page_of(status: LiveStatus) -> Page:
    """A page of a state that never changes."""
    return Page(lambda: status)
