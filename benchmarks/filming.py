"""How to film: what a camera's settings and a video's compression cost: `python benchmarks/filming.py [--only NAME]`.

The first rooms of each network's fixed test set, as they were drawn and as a camera would have taken them. All of it is
done to pictures `--times` as large as the networks see, which are scaled down then, as a flight's are. As in flight the
first is made as bright as the second then, but for `--as-they-come`.

    profile      D-Log (DJI's white paper of 2017) and HLG (ITU-R BT.2100), of which networks see the bytes as they are
    exposure     stops too dark or too bright for both pictures, or for the second alone, as where it is automatic
    noise        photons and 3 electrons of read noise a pixel, of 6,000 electrons at full scale at ISO 100
    blur         a shutter that is open for a share of the time between the two pictures; depth is that of its middle
    rolling      the last row is read a share of that time after the first; depth is that of each row's own time
    vignetting   brightness falls with the fourth power of the cosine, as through a simple lens, or with a lower one
    jpeg, h264   qualities; constant rate factors of x264, 23 where nobody says, more is worse
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from flightdepth.camera import Camera
from flightdepth.commands.terminal import counted
from flightdepth.evaluation.fixed_set import fixed_set
from flightdepth.evaluation.network import evaluate_network
from flightdepth.evaluation.provenance import origin_of
from flightdepth.ranges.exposure import exposed_as
from flightdepth.ranges.vignetting import Vignetting
from flightdepth.renderers.raycast import render
from flightdepth.runtimes.grid import NetworkGrid
from flightdepth.runtimes.network import load_network
from flightdepth.scenes import Scene, Textures
from flightdepth.stillbox import Picture, TestPair, TestSet
from flightdepth.stillbox.h264 import through_h264
from flightdepth.stillbox.pairs import Depth, Image
from flightdepth.stillbox.photometric import through_jpeg
from flightdepth.weights.card import NetworkCard

ELECTRONS, READ_ELECTRONS = (
    6000.0,
    3.0,
)  # at full scale at ISO 100, as of a sensor of 1/2.3 inch; a pixel's own noise
INSTANTS = 8  # pictures that make a blurred one
STRIPS = 32  # of rows read at one time

Linear = NDArray[np.float32]  # RGB [H, W, 3], 1 where a byte is 255
Way = Callable[["Shot"], "Shot"]


@dataclass(frozen=True)
class Shot:
    """Two pictures of a scene, uint8 RGB [H, W, 3], depth of the second, and what they are drawn from."""

    scene: Scene
    textures: Textures
    camera: Camera
    frames: tuple[int, int]
    pictures: tuple[Image, Image]
    depth_m: Depth

    @classmethod
    def of(cls, rooms: TestSet, number: int) -> Shot:
        drawn = rooms.drawn(number)
        scene, textures, camera, frames = drawn
        seen = render(scene, textures, camera, frames=frames)
        return cls(*drawn, (seen.images[0], seen.images[1]), seen.depth_m[1])

    def developed(self, curve: Callable[[Linear], Linear]) -> Shot:
        """Both pictures, linear, through a function to values of 0 to 1 that become bytes."""
        return replace(self, pictures=tuple(_bytes(curve(_linear(picture))) for picture in self.pictures))

    def taken(
        self, frame: int, shares: NDArray[np.float64], rows: slice = slice(None)
    ) -> tuple[Linear, Depth]:
        """Rows of pictures [N, ...] at times that lie shares [N] of the time between both frames from one of them."""
        first, last = self.frames
        at = frame + shares * (last - first)
        known = np.arange(self.scene.frames)
        path = np.stack([np.interp(at, known, axis) for axis in self.scene.camera_position.T], axis=1)
        turns = np.repeat(self.scene.world_from_camera[frame : frame + 1], len(at), axis=0)
        scene = replace(self.scene, camera_position=path, world_from_camera=turns)
        top, bottom, _ = rows.indices(self.camera.height)
        seen = render(scene, self.textures, self.camera.cropped(0, top, self.camera.width, bottom - top))
        return _linear(seen.images), seen.depth_m

    def shrunk(self, grid: NetworkGrid) -> TestPair:
        """As a network sees it."""
        previous, current = map(grid.image, self.pictures)
        times = self.camera.width // grid.camera.width
        depth_m = np.ascontiguousarray(self.depth_m[times // 2 :: times, times // 2 :: times])
        moved = self.scene.displacement(*self.frames)
        return TestPair(previous, current, depth_m, moved, grid.camera.fx)


def _linear(picture: Image) -> Linear:
    """By sRGB's curve (IEC 61966-2-1); the renderer's x^(1/2.2) gives bytes up to 18 less than half as much."""
    value = np.arange(256) / 255
    curve = np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)
    return curve.astype(np.float32)[picture]


def _srgb(linear: Linear) -> Linear:
    value = np.clip(linear, 0, 1)
    return np.where(value <= 0.0031308, 12.92 * value, 1.055 * value ** (1 / 2.4) - 0.055)


def _dlog(linear: Linear) -> Linear:
    """DJI, White Paper on D-Log and D-Gamut of DJI Cinema Color System, 2017."""
    curve = np.log10(linear * 0.9892 + 0.0108) * 0.256663 + 0.584555
    return np.where(linear <= 0.0078, 6.025 * linear + 0.0929, curve)


def _hlg(linear: Linear) -> Linear:
    """ITU-R BT.2100, with white at the 75 % that BT.2408 gives it."""
    light = linear * 0.265
    bright = 0.17883277 * np.log(np.maximum(12 * light - 0.28466892, 1e-9)) + 0.55991073
    return np.where(light <= 1 / 12, np.sqrt(3 * light), bright)


def _bytes(value: Linear) -> Image:
    return np.rint(np.clip(value, 0, 1) * 255).astype(np.uint8)


def profile(curve: Callable[[Linear], Linear]) -> Way:
    return lambda shot: shot.developed(curve)


def exposure(stops: float) -> Way:
    return lambda shot: shot.developed(lambda linear: _srgb(linear * np.float32(2.0**stops)))


def brightened(stops: float) -> Way:
    def way(shot: Shot) -> Shot:
        return replace(shot, pictures=(shot.pictures[0], exposure(stops)(shot).pictures[1]))

    return way


def noise(iso: int) -> Way:
    full = ELECTRONS * 100 / iso

    def way(shot: Shot) -> Shot:
        rng = np.random.default_rng(iso)

        def noisy(linear: Linear) -> Linear:
            caught = rng.poisson(linear * full) + READ_ELECTRONS * rng.standard_normal(linear.shape)
            return _srgb((caught / full).astype(np.float32))

        return shot.developed(noisy)

    return way


def blur(share: float) -> Way:
    instants = (np.arange(INSTANTS) + 0.5) / INSTANTS - 0.5

    def way(shot: Shot) -> Shot:
        pictures = (
            _bytes(_srgb(shot.taken(frame, instants * share)[0].mean(axis=0))) for frame in shot.frames
        )
        return replace(shot, pictures=tuple(pictures))

    return way


def rolling(share: float) -> Way:
    def way(shot: Shot) -> Shot:
        height = shot.camera.height
        edges = np.linspace(0, height, STRIPS + 1).astype(int)
        pictures = []
        for frame in shot.frames:
            strips = [
                shot.taken(frame, np.array([share * ((top + bottom) / 2 / height - 0.5)]), slice(top, bottom))
                for top, bottom in pairwise(edges)
            ]
            pictures.append(_bytes(_srgb(np.concatenate([linear[0] for linear, _ in strips]))))
        depth_m = np.concatenate([depth_m[0] for _, depth_m in strips])
        return replace(shot, pictures=tuple(pictures), depth_m=depth_m)

    return way


def vignetting(share: float) -> Way:
    def way(shot: Shot) -> Shot:
        x, y = shot.camera.ray_axes()
        fall = (1 + x**2 + y**2) ** (-2.0 * share)
        return shot.developed(lambda linear: _srgb(linear * fall[..., None].astype(np.float32)))

    return way


def jpeg(quality: int) -> Way:
    return lambda shot: replace(
        shot, pictures=tuple(through_jpeg(picture, quality) for picture in shot.pictures)
    )


def h264(factor: int) -> Way:
    return lambda shot: replace(shot, pictures=tuple(through_h264(shot.pictures, rate_factor=factor)))


WAYS: dict[str, dict[str, Way]] = {
    "profile": {"D-Log": profile(_dlog), "HLG": profile(_hlg)},
    "exposure": {f"both pictures {stops:+d} stops": exposure(stops) for stops in (-4, -2, 1, 2)}
    | {f"the second picture {stops:+g} stops": brightened(stops) for stops in (0.25, 0.5, 1)},
    "noise": {f"ISO {iso:,}": noise(iso) for iso in (100, 400, 1600, 6400)},
    "blur": {f"shutter open for {share:.0%} of the time": blur(share) for share in (0.05, 0.15, 0.3, 0.6)},
    "rolling": {f"read out in {share:.0%} of the time": rolling(share) for share in (0.1, 0.3)},
    # A corner of 90 degrees lies 55 off the axis, where the cosine's fourth power is a ninth.
    "vignetting": {
        f"corners with {9**-share:.0%} of the light": vignetting(share) for share in (0.1, 0.25, 0.5, 1)
    },
    "jpeg": {f"JPEG of quality {quality}": jpeg(quality) for quality in (95, 80, 60)},
    "h264": {f"H.264, factor {factor}": h264(factor) for factor in (18, 23, 28)},
}


def large_rooms(card: NetworkCard, scenes: int, times: int) -> TestSet:
    rooms = fixed_set(card, scenes=scenes)
    drawn = rooms.picture
    return replace(
        rooms, picture=Picture(times * drawn.width, times * drawn.height, times * drawn.full_width)
    )


def filmed(
    rooms: TestSet, name: str, way: Way, options: argparse.Namespace, grid: NetworkGrid
) -> Iterator[TestPair]:
    """Pairs as a network is shown them: evened out by what all of them tell of the lens, and equally bright."""
    shots = counted(range(len(rooms)), name, "pairs")
    pairs = [way(Shot.of(rooms, number)).shrunk(grid) for number in shots]
    if options.as_they_come:
        yield from pairs
        return
    lens = Vignetting(grid.camera)
    for pair in pairs if options.evens_out else ():
        lens.learn(pair.previous, pair.current)
    for pair in pairs:
        previous, current = lens.evened(pair.previous), lens.evened(pair.current)
        yield replace(pair, previous=exposed_as(previous, current, grid.camera), current=current)


def cells(found: dict[str, Any]) -> Iterator[str]:
    """Of the table's columns; a network without an error bar is believed everywhere."""
    errors = {
        who: tuple(f"{found[who][key]:.3f}" for key in ("l1_m", "abs_rel"))
        for who in ("network", "classical")
    }
    yield from errors["network"]
    spread = found.get("spread")
    yield from (f"{spread['believed'][key]:.1%}" if spread else "" for key in ("share", "inside_one"))
    yield from errors["classical"]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--networks", nargs="+", default=["motion"])
    parser.add_argument("--only", nargs="+", choices=WAYS, default=list(WAYS))
    parser.add_argument("--times", type=int, default=4)
    parser.add_argument("--scenes", type=int, default=40)
    parser.add_argument("--as-they-come", action="store_true")
    options = parser.parse_args()
    ways: dict[str, Way] = {"as drawn": lambda shot: shot}
    for only in options.only:
        ways |= WAYS[only]
    for name in options.networks:
        network = load_network(name, "openvino", precision="f32")
        options.evens_out = network.card.knows_direction  # as the estimator does
        rooms = large_rooms(network.card, options.scenes, options.times)
        large = rooms.drawn(0)[2]
        network = network.at_focal(large.fx / options.times)
        grid = network.grid(large)
        title = f"{network.card.name}, {len(rooms)} rooms, filmed {options.times} times as large"
        columns = ("L1 m", "relative", "believed", "inside one sigma", "classical peer, L1 m", "relative")
        table = Table("", *columns, title=title, caption=origin_of(network))
        for label, way in ways.items():
            found = evaluate_network(network, filmed(rooms, label, way, options, grid), set_name=label)
            table.add_row(label, *cells(found))
        Console().print(table)


if __name__ == "__main__":
    main()
