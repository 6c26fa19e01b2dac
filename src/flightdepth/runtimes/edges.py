"""Depth at a picture's own pixels: edges of depth lie where the picture has edges.

A network's pixel is a block of 4x4 of its picture's. Interpolated between two of them across an edge, depth is that of
nothing there: points that hang in the air between a pole and the field behind it. So where the blocks around a block
lie at clearly different depths, each of its pixels goes with those that look like it, the near ones, the far ones or
those of unknown depth, and has their mean (after the joint bilateral upsampling of Kopf et al. 2007). Elsewhere, and
among those, inverse depth is interpolated, which is linear in the picture of a plane.
"""

from __future__ import annotations

from functools import cached_property
from typing import Literal, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from flightdepth.levels import AnyImage
from flightdepth.runtimes.arrays import Flags, Maps
from flightdepth.runtimes.contract import OUTPUT_STRIDE
from flightdepth.runtimes.sampling import without_nan

STEP = 0.15  # of inverse depth: where it bends by more there is an edge
GAP = 1.2  # one depth over another: more are two sides of one
# Of the way, in logarithms, from the nearest to the farthest: beyond it a block may hold some of both.
SURE = 1 / 3
ALIKE = 20.0  # grey levels, deviation of a colour from that of a block that it belongs to
NEAR_BY = 0.7  # blocks, deviation of the place
UNLIKE = -7.0  # logarithm of the weight of a block of quite another colour: where all are, the place decides

BEND = np.array([[1, -2, 1]], np.float32)
NO_INVERSE = np.float32(1e9)  # 1/m, above every one
AROUND = [(row, column) for row in (-1, 0, 1) for column in (-1, 0, 1)]
# Of each pixel from its block's middle, blocks.
_INSIDE = (np.arange(OUTPUT_STRIDE) + 0.5) / OUTPUT_STRIDE - 0.5
_APART_2 = np.array([[(y - r) ** 2 + (x - c) ** 2 for r, c in AROUND] for y in _INSIDE for x in _INSIDE])
PLACE = np.exp(-_APART_2 / (2 * NEAR_BY**2)).astype(np.float32)  # [16 pixels, 9 blocks]


class Blocks:
    """What all maps [h, w] of a grid have in common.

    valid   [h, w]: the block shows the source, not padding
    shown   [h, w]: each block's own index in the flat map, for padding that of the nearest block that is none
    around  [h w, 9]: the indices of the blocks around each, itself too; at borders some come twice. Around padding,
            on which through a lens the source's outermost pixels lie, those that are shown there
    """

    def __init__(self, valid: Flags) -> None:
        self.valid = valid
        self.shown = _nearest_shown(valid)
        height, width = valid.shape
        rows, columns = np.indices(valid.shape).reshape(2, -1)
        beside = [((rows + r).clip(0, height - 1), (columns + c).clip(0, width - 1)) for r, c in AROUND]
        around = np.stack([row * width + column for row, column in beside], 1)
        self.around = np.where(valid.ravel()[:, None], around, self.shown.ravel()[around])


class SourceGrid(Protocol):
    """What brings maps to the source: `runtimes.grid.NetworkGrid`."""

    @property
    def blocks(self) -> Blocks:
        """Those of its maps."""

    def to_source(self, map_hw: Maps, /, interpolation: Literal["bilinear", "nearest"] = "bilinear") -> Maps:
        """A map at the output's or at the picture's size to the source's pixels."""


class AlongEdges:
    """Maps [h, w] that belong to a depth [h, w], at the pixels [4 h, 4 w] of its picture."""

    def __init__(self, depth_m: Maps, picture: AnyImage, blocks: Blocks) -> None:
        """`depth_m` in metres, NaN = unknown; `picture` RGB [4 h, 4 w, 3], 0 to 255."""
        self._shown, valid = blocks.shown, blocks.valid
        known = valid & (depth_m > 0)  # NaN is not
        inverse = np.divide(1, depth_m, out=np.zeros_like(depth_m), where=known)
        self._edges = np.nonzero(_has_edge(inverse.ravel()[self._shown], known.ravel()[self._shown]))
        self._around = blocks.around[self._edges[0] * valid.shape[1] + self._edges[1]]  # [N, 9]
        near_by, unknown = self._around, valid & ~known
        sides = _sides(inverse.ravel()[near_by], known.ravel()[near_by], unknown.ravel()[near_by])
        self._weights = _weights(picture, self._edges, self._around, sides)
        self.inverse_depth = self.finer(inverse)  # 1/m, 0 = unknown

    def finer(self, map_hw: Maps) -> Maps:
        """A map of the same blocks, [4 h, 4 w], without NaN; at edges of depth each pixel has its side's mean."""
        beside, _ = without_nan(map_hw.ravel()[self._shown])
        around = np.nan_to_num(map_hw.ravel()[self._around], copy=False, nan=0.0)
        return self._spread(beside, (self._weights @ around[..., None])[..., 0])

    def marks(self, map_hw: Maps) -> Maps:
        """The same, without interpolation and with NaN as it is."""
        return self._spread(
            map_hw.ravel()[self._shown], map_hw.ravel()[self._chosen], cv2.INTER_NEAREST_EXACT
        )

    @cached_property
    def _chosen(self) -> NDArray[np.intp]:
        """The block that has most to say of each pixel at an edge, [N, 16]."""
        return np.take_along_axis(self._around, self._weights.argmax(2), 1)

    def _spread(self, map_hw: Maps, at_edges: Maps, how: int = cv2.INTER_LINEAR) -> Maps:
        h, w = map_hw.shape
        fine = np.empty((h, OUTPUT_STRIDE, w, OUTPUT_STRIDE), np.float32)
        whole = fine.reshape(h * OUTPUT_STRIDE, w * OUTPUT_STRIDE)
        cv2.resize(map_hw, whole.shape[::-1], dst=whole, interpolation=how)
        fine.swapaxes(1, 2)[self._edges] = at_edges.reshape(-1, OUTPUT_STRIDE, OUTPUT_STRIDE)
        return whole


class EdgeSampling:
    """Maps of a network's output at the source's pixels [H, W], with edges where the picture has them."""

    def __init__(self, grid: SourceGrid, depth_m: Maps, picture: AnyImage) -> None:
        """See `AlongEdges`; `grid` is that of the picture."""
        self._grid, self._edges = grid, AlongEdges(depth_m, picture, grid.blocks)
        fine = self._edges.inverse_depth
        inverse = grid.to_source(fine)
        # Between two pixels of the picture there are several of the source, and nothing hangs in the air there either.
        steps = grid.to_source(np.where(_has_step(fine), fine, np.float32(np.nan)), "nearest")
        np.copyto(inverse, steps, where=steps >= 0)
        np.copyto(inverse, np.float32(np.nan), where=inverse <= 0)
        self.depth_m: Maps = np.divide(1, inverse, out=inverse)  # NaN = unknown
        self._unknown = np.isnan(inverse)

    def __call__(self, map_hw: Maps) -> Maps:
        """Another map of the same pixels, NaN where depth is."""
        sampled = self._grid.to_source(self._edges.finer(map_hw))
        np.copyto(sampled, np.float32(np.nan), where=self._unknown)
        return sampled

    def marks(self, map_hw: Maps) -> Maps:
        """A map that is not to be interpolated; NaN where NaN."""
        return self._grid.to_source(self._edges.marks(map_hw), "nearest")


def _nearest_shown(valid: Flags) -> NDArray[np.intp]:
    """Each block's own index in the flat map, for padding that of the nearest block that is none, [h, w]."""
    own = np.arange(valid.size).reshape(valid.shape)
    if valid.all() or not valid.any():
        return own
    _, labels = cv2.distanceTransformWithLabels(
        (~valid).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    block_of = np.zeros(labels.max() + 1, np.intp)
    block_of[labels[valid]] = own[valid]
    nearest: NDArray[np.intp] = block_of[labels]
    return nearest


def _has_edge(inverse: Maps, known: Flags) -> Flags:
    """Whether depth jumps or bends at a block or beside it, or is known at some of those blocks and not at others.

    `inverse` [h, w] in 1/m; both in padding as beside it. Along a plane, however steep, its second differences are 0.
    """
    around = np.ones((3, 3), np.uint8)
    bends = [cv2.filter2D(inverse, -1, line, borderType=cv2.BORDER_REPLICATE) for line in (BEND, BEND.T)]
    bend = cv2.dilate(np.maximum(*(np.abs(each) for each in bends)), around)
    some_known, some_not = (cv2.dilate(each.astype(np.uint8), around) > 0 for each in (known, ~known))
    jumps = bend > np.float32(STEP) * cv2.dilate(inverse, around)
    return np.asarray(some_known & (jumps | some_not))


def _has_step(inverse: Maps) -> Flags:
    """Whether one of the pixels around has a clearly different depth."""
    around = np.ones((3, 3), np.uint8)
    least, most = cv2.erode(inverse, around), cv2.dilate(inverse, around)
    return np.asarray(most > np.float32(GAP) * least)


def _weights(
    picture: AnyImage, blocks: tuple[NDArray[np.intp], ...], around: NDArray[np.intp], sides: Maps
) -> Maps:
    """What the nine blocks `around` each of N have to say of its 16 pixels, [N, 16, 9]; they sum to 1.

    Only blocks of one of the `sides` [N, 3, 9] have a say: of the one that a pixel looks most like.
    """
    height, width = (side // OUTPUT_STRIDE for side in picture.shape[:2])
    means = np.asarray(cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA), picture.dtype)
    pixels = picture.reshape(height, OUTPUT_STRIDE, width, OUTPUT_STRIDE, 3).swapaxes(1, 2)[blocks]
    weights = _likeness(pixels.reshape(-1, OUTPUT_STRIDE**2, 3), means.reshape(-1, 3)[around])
    weights *= PLACE
    # By small matrices, here and elsewhere: einsum takes ten times as long.
    near, far, nothing = np.moveaxis(weights @ sides.swapaxes(1, 2), 2, 0)
    best = np.where(near >= np.maximum(far, nothing), 0, np.where(far >= nothing, 1, 2))  # [N, 16]
    weights *= sides.reshape(-1, len(AROUND))[best + 3 * np.arange(len(best))[:, None]]
    weights /= weights @ np.ones((len(AROUND), 1), np.float32)
    return weights


def _likeness(pixels: AnyImage, means: AnyImage) -> Maps:
    """exp(-|p - m|^2 / 2 ALIKE^2) of colours [N, 16, 3] and [N, 9, 3], [N, 16, 9], at least exp(UNLIKE)."""
    p, m = (colours.astype(np.float32) / np.float32(ALIKE) for colours in (pixels, means))
    exponent = p @ m.swapaxes(1, 2)
    exponent -= np.einsum("npc,npc->np", p, p)[:, :, None] / 2
    exponent -= np.einsum("nkc,nkc->nk", m, m)[:, None] / 2
    np.maximum(exponent, np.float32(UNLIKE), out=exponent)
    return np.asarray(np.exp(exponent, out=exponent))


def _sides(inverse: Maps, known: Flags, unknown: Flags) -> Maps:
    """Which of the blocks [N, 9] are surely near, surely far and unknown, 1 or 0, [N, 3, 9]; no gap: all are near."""
    nearest = np.where(known, inverse, np.float32(0)).max(1, keepdims=True)
    farthest = np.where(known, inverse, NO_INVERSE).min(1, keepdims=True)
    gap = nearest > np.float32(GAP) * farthest
    ratio = np.divide(nearest, farthest, out=np.ones_like(nearest), where=gap) ** np.float32(SURE)
    near = known & (~gap | (inverse * ratio >= nearest))
    far = known & gap & (inverse <= farthest * ratio)
    return np.stack([near, far, unknown], 1).astype(np.float32)
