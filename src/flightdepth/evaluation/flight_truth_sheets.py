"""Pictures of a flight's errors: input and signed error above, truth and depth below, in the preview's colours."""

from __future__ import annotations

import cv2
import numpy as np

from flightdepth.evaluation.flight_truth import FlightTruth, FrameErrors
from flightdepth.evaluation.pictures import error_picture
from flightdepth.evaluation.true_depth import at_centres
from flightdepth.levels import Image
from flightdepth.outputs.encoding import FARTHEST, UNIT_M
from flightdepth.outputs.legend import FAINT_RGB, GROUND_RGB, LEGEND_WIDTH, legend, write
from flightdepth.outputs.palette import DepthScale, Palette
from flightdepth.outputs.preview import BASELINE, CAPTION_HEIGHT, FOOTER_HEIGHT, Layout
from flightdepth.outputs.read import FlightFolder
from flightdepth.runtimes.arrays import Maps

FULL_ERROR = 0.25  # of the truth: an error of this share or more has the full colour
PANELS = 4


class Sheets:
    """Draws frames of a flight beside their truth."""

    def __init__(self, folder: FlightFolder) -> None:
        camera = folder.record.source.camera
        self._folder, self._palette = folder, Palette(DepthScale())
        self._layout = Layout.of(camera.width, camera.height, PANELS)

    def draw(self, image: Image | None, truth_m: Maps, errors: FrameErrors) -> Image:
        """RGB of one frame: its picture [H, W, 3], None where there is none, and its truth [h, w], infinite sky."""
        width, height = self._layout.size
        sheet = np.full((height, width, 3), GROUND_RGB, np.uint8)
        tall = height - FOOTER_HEIGHT - CAPTION_HEIGHT
        sheet[CAPTION_HEIGHT : CAPTION_HEIGHT + tall, width - LEGEND_WIDTH :] = legend(
            self._palette.scale, tall
        )
        depth_m = self._folder.depth_m(errors.index)
        self._place(
            sheet, 0, "input" if image is not None else "input: not in the preview", self._sized(image)
        )
        error = relative_error(at_centres(depth_m, truth_m.shape), truth_m)
        said = f"error: red {FULL_ERROR:.0%} too far, blue too near"
        self._place(sheet, 1, said, self._sized(error))
        self._place(sheet, 2, "truth", self._truth(truth_m))
        self._place(sheet, 3, "depth", self._depth(depth_m, errors.index))
        write(sheet, footer(errors), 10, height - 10, FAINT_RGB)
        return sheet

    def _place(self, sheet: Image, panel: int, caption: str, picture: Image) -> None:
        x, y = self._layout.corner(panel)
        write(sheet, caption, x + 8, y - CAPTION_HEIGHT + BASELINE)
        sheet[y : y + self._layout.height, x : x + self._layout.width] = picture

    def _sized(self, picture: Image | None) -> Image:
        size = self._layout.width, self._layout.height
        if picture is None:
            return np.zeros((*size[::-1], 3), np.uint8)
        return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_NEAREST), np.uint8)

    def _truth(self, truth_m: Maps) -> Image:
        sky_m = np.where(np.isposinf(truth_m), np.float32(FARTHEST * UNIT_M), np.float32(np.nan))
        finite_m = np.where(np.isfinite(truth_m), truth_m, np.float32(np.nan))
        return self._painted(finite_m, sky_m, None)

    def _depth(self, depth_m: Maps, index: int) -> Image:
        bounds_m = self._folder.farther_than_m(index), self._folder.nearer_than_m(index)
        return self._painted(depth_m, *bounds_m)

    def _painted(self, depth_m: Maps, farther_m: Maps | None, nearer_m: Maps | None) -> Image:
        size = self._layout.width, self._layout.height
        return self._palette.fitted(size, depth_m, farther_m, nearer_m)


def relative_error(depth_m: Maps, truth_m: Maps) -> Image:
    """RGB [h, w, 3]: green no error, red too far, blue too near (a depth in the sky too), full at FULL_ERROR."""
    return error_picture(depth_m / truth_m, np.ones_like(truth_m), FULL_ERROR)


def footer(errors: FrameErrors) -> str:
    """One frame's figures."""
    if not errors.known > 0:
        return f"frame {errors.index}   no depth where the truth is known"
    return (
        f"frame {errors.index}   known {errors.known:.0%}   relative error {errors.abs_rel:.1%}"
        f"   depth / truth {errors.ratio:.2f} at the median"
    )


def chosen(found: FlightTruth, most: int, worst: int) -> dict[int, FrameErrors]:
    """At most so many frames by their index: the `worst`, and others evenly spread."""
    every = max(1, -(-len(found.frames) // (most - worst)))
    return {frame.index: frame for frame in (*found.frames[::every], *found.worst(worst))}
