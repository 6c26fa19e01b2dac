"""The page to watch a live run: what the camera sees, depth, the obstacle fan and the engine's health."""

from flightdepth.live.page.server import Page, PageServer

__all__ = ["Page", "PageServer"]
