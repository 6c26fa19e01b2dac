"""A network that is ready to use: frame pairs in, metres out."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.levels import AnyImage, Image
from flightdepth.runtimes.alignment import align
from flightdepth.runtimes.arrays import Flags, Maps
from flightdepth.runtimes.coarser import beyond_reach, coarser_grid, take_near
from flightdepth.runtimes.contract import DEPTH, SIGMA, Arrays, Precision, Runtime
from flightdepth.runtimes.devices import OPENVINO_DEVICES, on_cpu, open_runtime
from flightdepth.runtimes.error_bar import error_bar_scale
from flightdepth.runtimes.grid import NetworkGrid, check_image, filling_focal_px, wide_focal_px
from flightdepth.runtimes.inputs import paired_inputs, swept_inputs
from flightdepth.runtimes.memory import OutOfMemory
from flightdepth.runtimes.onnx_openvino import unfit_weights
from flightdepth.runtimes.prediction import Prediction
from flightdepth.weights.card import NetworkCard
from flightdepth.weights.store import (
    SHIPPED,
    StoredNetwork,
    find_network,
    read_card,
    read_network,
    shipped_networks,
)

GRIDS_KEPT = 8  # cameras in use at the same time; a source and its grid make two
WORTH_IT = 1.02  # a network for any lens sees that much finer, if its grid has room


class Network:
    """Depth from two frames and the displacement between them.

    card         how it was trained and how well it does
    runtime      what runs it
    cpu          opens the same network on the CPU, for a device that has no memory left; None: there is none
    aligned      whether depth is aligned with the pictures, where the direction is known (see `alignment`)
    """

    def __init__(
        self,
        card: NetworkCard,
        runtime: Runtime,
        cpu: Callable[[], Runtime] | None = None,
        *,
        aligned: bool = True,
    ) -> None:
        self.card = card
        self.runtime = runtime
        self.aligned = aligned
        self._cpu = cpu
        self._grids: dict[Camera, NetworkGrid] = {}

    def __repr__(self) -> str:
        return f"Network({self.card.name!r}, {self.runtime.description})"

    def grid(self, camera: Camera) -> NetworkGrid:
        """The network's view of `camera`; the tables are made once per camera. A view's own view is itself."""
        if not isinstance(camera, Camera):
            raise BadInput("camera", expected="a flightdepth.Camera", got=repr(camera))
        if camera not in self._grids:
            for seldom in list(self._grids)[: max(0, len(self._grids) + 2 - GRIDS_KEPT)]:
                del self._grids[seldom]
            grid = NetworkGrid(camera, self.focal_px(camera))
            self._grids[grid.camera] = NetworkGrid(grid.camera, None)
            self._grids[camera] = grid
        grid = self._grids.pop(camera)
        self._grids[camera] = grid
        return grid

    def focal_px(self, camera: Camera) -> float:
        """Focal length of the pictures that the network sees of `camera`'s; for any thread."""
        if not self.card.any_lens:
            return self.card.focal_px
        # A long lens is seen finer, at the price of others. Pixels that the source does not have would tell nothing;
        # those that the padding takes cost nothing.
        focal_px = min(max(self.card.focal_px, wide_focal_px(camera, self.card.focal_px)), camera.fx)
        filled_px = min(filling_focal_px(camera, focal_px), camera.fx)
        return focal_px if filled_px < focal_px * WORTH_IT else filled_px

    def depth(self, previous: Image, current: Image, displacement: ArrayLike, camera: Camera) -> Maps:
        """Depth of `current` in metres, float32 [H, W]; NaN where unknown, all NaN for displacement 0.

        previous, current  uint8 RGB [H, W, 3], stabilised: `previous` rotated into `current`'s orientation
        displacement       metres, (3,) in `current`'s frame; or a bare length, if the network needs no direction
        """
        if np.shape(displacement) not in ((), (3,)):
            got = f"shape {list(np.shape(displacement))}"
            raise BadInput("displacement", expected="a vector of 3, or a length, in metres", got=got)
        grid = self.grid(camera)
        for what, image in (("previous image", previous), ("current image", current)):
            check_image(what, image, camera)
        found, seen = self._predict([previous], current, np.asarray(displacement)[None], camera)
        return grid.along_edges(found.depth_m[0], seen).depth_m

    def predict(
        self,
        previous_n: Sequence[AnyImage] | AnyImage,
        current: AnyImage,
        displacements: ArrayLike,
        camera: Camera,
        valid: Flags | None = None,
    ) -> Prediction:
        """One batch of n pairs that share `current`: maps on the output grid, padding included (see `valid`).

        previous_n     n pictures RGB [H, W, 3], 0 to 255: uint8, or float32 for a grid's own camera
        displacements  metres, (n, 3) in `current`'s frame; or bare lengths (n,), if the network needs no direction
        valid          [h, w] bool, which outputs count, for who masks some; None: those of the camera's grid
        """
        return self._predict(previous_n, current, displacements, camera, valid)[0]

    def _predict(
        self,
        previous_n: Sequence[AnyImage] | AnyImage,
        current: AnyImage,
        displacements: ArrayLike,
        camera: Camera,
        valid: Flags | None = None,
    ) -> tuple[Prediction, AnyImage]:
        """The maps, and `current` on the grid."""
        lengths_m = displacement_lengths(displacements, len(previous_n))
        if self.card.knows_direction and np.ndim(displacements) != 2:
            if lengths_m.any():
                raise BadInput(
                    f"displacement for {self.card.name}",
                    expected="a vector of 3 for each previous image: it needs the direction",
                    got="a length",
                    mend="Give vectors in the current camera's frame, or take a DepthNet.",
                )
            displacements = np.zeros((len(lengths_m), 3))  # no motion has no direction
        grid = self.grid(camera)
        grid.check("current image", current)
        for previous in previous_n:
            grid.check("previous image", previous)
        on_grid = [grid.image(previous) for previous in previous_n]
        seen, valid = grid.image(current), grid.valid if valid is None else valid
        output = self._look(on_grid, seen, np.asarray(displacements), grid, valid)
        if self.card.knows_direction and self.aligned:
            align(self.card, output, on_grid, seen, np.asarray(displacements), camera=grid.camera)
        beta = output[DEPTH] / np.float32(self.card.depth_max_m)
        alpha = self.card.at_focal(grid.camera.fx).alpha
        metres = np.where(lengths_m > 0, alpha * lengths_m, np.nan).astype(np.float32)[:, None, None]
        sigma_m = None
        if SIGMA in output:
            scale = error_bar_scale(self.card, beta, valid, grid.camera.fx)
            sigma_m = output[SIGMA] * (scale / np.float32(self.card.depth_max_m)) * metres
        return Prediction(beta, beta * metres, sigma_m, valid), seen

    def at_focal(self, focal_px: float) -> Network:
        """The same network with its pictures scaled to another focal length, where it knows any."""
        card = self.card.at_focal(focal_px)
        if card == self.card:
            return self  # and keeps its grids
        return Network(card, self.runtime, self._cpu, aligned=self.aligned)

    def finer(self, times: float) -> Network:
        """The same network with pictures that much finer (0.5: coarser), at `times`^2 the price; for any lens."""
        if times == 1:
            return self
        if not (self.card.any_lens and 0.2 <= times <= 5):
            expected = "0.2 to 5" if self.card.any_lens else f"1: {self.card.name} knows one focal length"
            raise BadInput("detail", expected=expected, got=f"{times:g}")
        return self.at_focal(self.card.focal_px * times)

    def move_to_cpu(self) -> bool:
        """Go on there, where the device has no memory left; False where this is the last resort already."""
        if self._cpu is None:
            return False
        self.runtime, self._cpu = self._cpu(), None
        return True

    def warm_up(self, camera: Camera, pairs: int = 1) -> None:
        """Compile for batches of 1 to `pairs`, a third of a second a size; a flight's first frames would wait.

        A batch that the device has no memory for is left: who flies finds out, and says so.
        """
        grid: NetworkGrid | None = self.grid(camera)
        while grid is not None:
            blank = np.zeros((grid.camera.height, grid.camera.width, 3), dtype=np.uint8)
            with suppress(OutOfMemory):
                for n in range(1, pairs + 1):
                    self.runtime(self._batch([blank] * n, blank, np.ones((n, 3)), grid.camera))
            grid = coarser_grid(self.card, grid.camera)

    def _look(
        self,
        previous_n: list[AnyImage],
        current: AnyImage,
        displacements: NDArray[np.float64],
        grid: NetworkGrid,
        valid: Flags,
    ) -> dict[str, Maps]:
        """Outputs for pictures on `grid`; what moved too far there, if that is enough, is seen in smaller ones."""
        output = self.runtime(self._batch(previous_n, current, displacements, grid.camera))
        far = beyond_reach(self.card, output[DEPTH], valid)
        smaller = coarser_grid(self.card, grid.camera) if far else None
        if smaller is not None:
            shrunk = [smaller.image(previous_n[i]) for i in far]
            coarse = self._look(shrunk, smaller.image(current), displacements[far], smaller, smaller.valid)
            take_near(self.card, output, far, coarse, smaller)
        return output

    def _batch(
        self,
        previous_n: list[AnyImage],
        current: AnyImage,
        displacements: NDArray[np.float64],
        camera: Camera,
    ) -> Arrays:
        if self.card.knows_direction:
            return swept_inputs(previous_n, current, displacements, camera)
        return paired_inputs(previous_n, current)


def displacement_lengths(displacements: ArrayLike, n: int) -> NDArray[np.float64]:
    """Lengths in metres, shape (n,), of displacements (n, 3) or of bare lengths (n,)."""
    given = np.asarray(displacements, dtype=np.float64)
    if n == 0 or given.shape not in ((n,), (n, 3)):
        raise BadInput(
            "displacements",
            expected=f"{n} lengths or {n} vectors of 3, one per previous image, at least one",
            got=f"shape {list(given.shape)}",
        )
    lengths = np.linalg.norm(given, axis=1) if given.ndim == 2 else given
    if not (np.isfinite(lengths) & (lengths >= 0)).all():
        raise BadInput("displacements", expected="finite metres, no negative length", got=str(given.tolist()))
    return lengths


def load_network(
    name_or_path: str | Path,
    device: str = "auto",
    *,
    precision: Precision | None = None,
    threads: int | None = None,
    aligned: bool = True,
) -> Network:
    """Open a shipped network by name, or an ONNX file with its card beside it.

    device     "auto" (OpenVINO on the CPU), "cpu", "openvino", "onnxruntime", "cuda", "tensorrt" or "coreml"
    precision  None takes bf16 where the card says that it costs at most 1 %, else f32; int8 is for CPUs with VNNI
    threads    None uses every core
    aligned    whether depth is aligned with the pictures, where the network knows the direction (`alignment`)
    """
    stored = read_network(name_or_path)
    refuse_broken_weights(stored)
    runtime = open_runtime(stored.card, stored.onnx, device=device, precision=precision, threads=threads)
    contract = "MotionNet" if stored.card.knows_direction else "DepthNet"  # which FlowNetS keeps too
    if runtime.architecture != contract:
        raise BadInput(
            f"weights of {stored.card.name}",
            expected=f"a {stored.card.architecture}, as the card says",
            got=f"a {runtime.architecture}",
            mend="The card belongs to other weights; export the network again.",
        )
    elsewhere = device not in OPENVINO_DEVICES
    cpu = partial(on_cpu, stored.card, stored.onnx, threads=threads) if elsewhere else None
    return Network(stored.card, runtime, cpu, aligned=aligned)


def refuse_broken_weights(stored: StoredNetwork) -> None:
    """Refuse weights that are not numbers: each depth would be one of them, or none."""
    for name, share in unfit_weights(stored.onnx):
        raise BadInput(
            f"weights of {stored.card.name}",
            expected="finite numbers",
            got=f"NaN or infinity in {share:.0%} of {name}",
            mend="The training diverged, or the file is damaged; take an earlier checkpoint.",
        )


def networks() -> tuple[str, ...]:
    """Names of the networks that ship with the package."""
    return shipped_networks()


def nearest_network(camera: Camera, folder: Path = SHIPPED) -> str:
    """The network in `folder` for a camera: one for any lens, else that of the nearest focal length, as a ratio.

    Of several as near: that of the fewest feature maps (`base_width`); then, of those for any lens, that of the longest
    focal length, which sees finest; then the first by name.
    """
    names = shipped_networks(folder)
    if not names:
        raise BadInput(
            "network", expected="a shipped one", got="none in this build", mend="Give --network FILE."
        )

    def rank(name: str) -> tuple[float, int, float, str]:
        card = read_card(folder / f"{name}.onnx")
        off = 0.0 if card.any_lens else round(abs(math.log(card.focal_px / camera.fx)), 6)
        return off, card.base_width, -card.focal_px if card.any_lens else 0.0, name

    return min(names, key=rank)


def lightest_network(card: NetworkCard) -> str | None:
    """The shipped network of the same kind that takes least time; None where none takes less than this one."""

    def price(each: NetworkCard) -> float:
        """Root of the time: feature maps and sides of the pictures count squared."""
        return each.base_width * each.focal_px

    cards = [read_card(find_network(name)) for name in shipped_networks()]
    lightest = min(
        (each for each in cards if each.knows_direction == card.knows_direction), key=price, default=card
    )
    return lightest.name if price(lightest) < price(card) else None
