"""`flightdepth demo`: the sample flight from end to end, and how far its depth is from the truth."""

from __future__ import annotations

import time
from collections import deque
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from flightdepth.commands.network_options import NetworkOption
from flightdepth.commands.run_settings import RunSettings
from flightdepth.commands.signals import stopped_as_by_ctrl_c
from flightdepth.commands.single_flight import conclude, introduce, source_of, write_depth
from flightdepth.commands.terminal import counted, say, show_table

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from flightdepth.camera import Camera
    from flightdepth.evaluation.flight_errors import FlightErrors
    from flightdepth.flight import Frame
    from flightdepth.ranges import RangedDepth
    from flightdepth.weights.card import NetworkCard

    Image = NDArray[np.uint8]
    Map = NDArray[np.float32]
    Vector = NDArray[np.float64]

SAMPLE = Path(__file__).parents[1] / "sample"
VIDEO, LOG, CALIBRATION = SAMPLE / "flight.mp4", SAMPLE / "telemetry.csv", SAMPLE / "camera.json"
POSES, TRUTH = SAMPLE / "poses.csv", SAMPLE / "truth"
# The truth holds the depth at the centre of each fifth pixel of each fifth row, from number 2 on.
TRUTH_STEP_PX, TRUTH_OFFSET_PX = 5, 2
AT_TRUTH = (slice(TRUTH_OFFSET_PX, None, TRUTH_STEP_PX),) * 2  # its pixels in a map [H, W]
SKY_M = 655.0  # what lies farther in the truth is sky
NETWORK, PEER = "network", "classical"


def demo(
    out: Annotated[Path, typer.Option(metavar="DIR", help="Output folder.")] = Path("flightdepth-demo"),
    network: NetworkOption = None,
) -> None:
    """Run the sample flight that ships with the package: ten rendered seconds whose true depth is known.

    Writes what `flightdepth run` writes, then shows the error per range of
    depth beside that of a classical method: optical flow and triangulation.
    """
    from flightdepth.flight import open_flight
    from flightdepth.runtimes.network import load_network, nearest_network

    settings = RunSettings(telemetry=LOG, camera=CALIBRATION, network=network)  # as `flightdepth run` would
    with stopped_as_by_ctrl_c(), open_flight(VIDEO, settings.telemetry, settings.camera) as flight:
        loaded = load_network(network or nearest_network(flight.camera))
        introduce(VIDEO, flight, loaded)
        witness = Witness()
        started = time.monotonic()
        source = source_of("sample flight", flight, loaded, settings)
        summary = write_depth(source, flight, loaded, out, settings, watch=witness.see)
        elapsed_s = time.monotonic() - started
        errors, sky = compare(witness.moments, flight.camera, loaded.card)
    show_table(errors.table())
    say(f"over {len(witness.moments)} frames; share of the sky that was given a depth: {sky}")
    say(f"{PEER}: optical flow (DIS) and triangulation of the same frame pairs, with the true displacements")
    conclude(summary, elapsed_s, out)


@dataclass(frozen=True, eq=False)
class Moment:
    """A frame whose truth is known: its number, picture and depth [H, W], and the frames paired with it."""

    index: int
    image: Image
    depth_m: Map
    shifts: tuple[int, ...]
    previous: tuple[Image, ...]


class Witness:
    """Watches a run, and keeps the moments that can be compared with the truth."""

    def __init__(self) -> None:
        from flightdepth.ranges.pairs import MAX_FRAMES

        self.moments: list[Moment] = []
        self._recent: deque[Image] = deque(maxlen=MAX_FRAMES + 1)
        self._with_truth = {int(path.stem) for path in TRUTH.glob("*.png")}

    def see(self, frame: Frame, result: RangedDepth) -> None:
        """Take one frame and its result, in the order of the flight."""
        self._recent.append(frame.image)
        if frame.index in self._with_truth:
            shifts = tuple(int(shift) for shift in result.shifts)
            previous = tuple(self._recent[-1 - shift] for shift in shifts)
            self.moments.append(Moment(frame.index, frame.image, result.depth_m, shifts, previous))


def compare(moments: list[Moment], camera: Camera, card: NetworkCard) -> tuple[FlightErrors, str]:
    """Errors of the network and of the peer, and a line on how much of the sky got a depth from each."""
    import numpy as np

    from flightdepth.evaluation.flight_errors import FlightErrors
    from flightdepth.evaluation.network_tables import percent
    from flightdepth.outputs import read_depth

    errors, poses = FlightErrors(), np.loadtxt(POSES, delimiter=",", skiprows=1)
    sky_shares: dict[str, list[float]] = {NETWORK: [], PEER: []}
    for moment in counted(moments, "classical peer", "frames"):
        truth_m = read_depth(TRUTH / f"{moment.index:06d}.png")
        depths = {NETWORK: moment.depth_m, PEER: peer_depth(moment, poses, camera, card)}
        for name, depth_m in depths.items():
            at_truth_m = depth_m[AT_TRUTH]
            errors.add(name, at_truth_m, truth_m)
            sky_shares[name].append(float(np.isfinite(at_truth_m[truth_m > SKY_M]).mean()))
    sky = ", ".join(f"{name} {percent(float(np.mean(shares)))}" for name, shares in sky_shares.items())
    return errors, sky


def peer_depth(moment: Moment, poses: Vector, camera: Camera, card: NetworkCard) -> Map:
    """The classical peer's depth [H, W]: it sees the estimator's pairs, and its maps are fused alike."""
    import numpy as np

    from flightdepth.evaluation.peer import ClassicalPeer
    from flightdepth.motion import rotation_from_quaternion
    from flightdepth.ranges.fusion import fuse

    if not moment.shifts:
        return np.full_like(moment.depth_m, np.nan)
    world_from_camera = rotation_from_quaternion(poses[moment.index, 4:8])
    earlier = poses[moment.index - np.array(moment.shifts), 1:4]
    displacements = (poses[moment.index, 1:4] - earlier) @ world_from_camera
    lengths_m = np.linalg.norm(displacements, axis=1)
    betas = []
    for previous, displacement, reach_m in zip(
        moment.previous, displacements, card.alpha * lengths_m, strict=True
    ):
        peer = ClassicalPeer(card.beta_min * reach_m, reach_m)
        betas.append(peer.depth(previous, moment.image, displacement, camera) / np.float32(reach_m))
    return fuse(np.stack(betas), lengths_m, card).depth_m
