"""Sets of next to no size. As a script, a render that kills itself: python small_sets.py LAYOUT FOLDER WHERE CALL."""

from __future__ import annotations

import os
import pathlib
import signal
import sys
import tarfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from flightdepth.renderers.raycast import Rendered, render
from flightdepth.scenes import Scene, StillBoxConfig, Textures
from flightdepth.stillbox import original_layout, shards
from flightdepth.stillbox.encoding import Source
from flightdepth.stillbox.engines import on_threads
from flightdepth.stillbox.set_on_disk import Layout, open_set
from flightdepth.stillbox.sets import SceneSet

TEXTURES = Textures.procedural(2, 1)
SCENES = 7
A_FOLDER = 3  # scenes in a folder, and in a shard


def small_source(seed: int = 1, **knobs: Any) -> Source:
    """Three frames of 16x12 px a scene."""
    return Source(SceneSet(StillBoxConfig(**({"frames": 3} | knobs)), 16, 12, seed))


def as_rendered(source: Source, number: int) -> tuple[Scene, Rendered]:
    """Scene `number` of a source and all its frames, as they are before anything is stored."""
    scene = source.scenes.scene(number, len(TEXTURES))
    return scene, render(scene, TEXTURES, source.scenes.camera)


def render_small(
    folder: Path, layout: Layout = Layout.FOLDER, scenes: int = SCENES, source: Source | None = None
) -> int:
    """Render what is missing of a small set; how many scenes stood before."""
    source = source or small_source()
    with open_set(folder, layout, "small", source.arguments(TEXTURES), scenes) as target:
        standing = target.standing
        for scene in on_threads(source, TEXTURES, range(standing, scenes), threads=1):
            target.add(scene)
    return standing


def tree(folder: Path) -> dict[str, bytes]:
    """Every file below a folder."""
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def killed_at(call: int, function: Callable[..., Any], before: Callable[..., None]) -> Callable[..., Any]:
    """`function`, but call number `call` does only `before`; then the process is killed."""
    calls = 0

    def wrapped(*arguments: Any, **named: Any) -> Any:
        nonlocal calls
        calls += 1
        if calls == call:
            before(*arguments)
            os.kill(os.getpid(), signal.SIGKILL)
        return function(*arguments, **named)

    return wrapped


def main() -> None:
    layout, folder, where, call = sys.argv[1:]
    original_layout.SCENES_PER_FOLDER = shards.SCENES_PER_SHARD = A_FOLDER
    original_layout.SAVE_EVERY_S = 0.0
    write = pathlib.Path.write_bytes
    if where == "half a file":
        pathlib.Path.write_bytes = killed_at(  # type: ignore[method-assign]
            int(call), write, lambda path, data: write(path, data[: len(data) // 2])
        )
    elif where == "flush":
        os.fsync = killed_at(int(call), os.fsync, lambda _: None)
    elif where == "half a shard":
        tarfile.TarFile.addfile = killed_at(  # type: ignore[method-assign]
            int(call), tarfile.TarFile.addfile, lambda tar, *_: tar.fileobj.flush()
        )
    render_small(Path(folder), Layout(layout))


if __name__ == "__main__":
    main()
