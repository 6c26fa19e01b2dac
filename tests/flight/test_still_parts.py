"""What stands still in the pictures of a camera that turns, drawn into views of a world at infinity."""

import cv2
import numpy as np
import pytest

from flightdepth.camera import Camera
from flightdepth.flight.still_parts import FEWEST, StillParts
from flightdepth.motion import NED_FROM_CAMERA

CAMERA = Camera.from_fov(480, 270, 70)
STEPS = FEWEST + 6
PANS = [(0.0, 3.0 * step) for step in range(STEPS)]  # pitch and yaw, degrees
NODS = [(2.5 * (step % 8), 1.0 * step) for step in range(STEPS)]
ROWS, COLUMNS = np.mgrid[:270, :480]
RNG = np.random.default_rng(4)
# 8 texels a degree of azimuth, 24 below the horizon; above it a bright sky without anything.
GROUND = cv2.GaussianBlur(RNG.integers(0, 256, (720, 2880), np.uint8), (0, 0), 4)
GROUND = cv2.normalize(GROUND, None, 20, 160, cv2.NORM_MINMAX)


def attitude(pitch_deg, yaw_deg):
    """World from camera, of one that looks down by the pitch, and as far to the right of north."""
    right = cv2.Rodrigues(np.radians([0.0, -pitch_deg, 0.0]))[0]
    down = cv2.Rodrigues(np.radians([0.0, 0.0, yaw_deg]))[0]
    return down @ right @ NED_FROM_CAMERA


def view(pitch_deg, yaw_deg):
    """The world as such a camera sees it: textured ground to the horizon, nothing above."""
    right = cv2.Rodrigues(np.radians([0.0, -pitch_deg, 0.0]))[0]
    down = cv2.Rodrigues(np.radians([0.0, 0.0, yaw_deg]))[0]
    north, east, below = np.moveaxis(CAMERA.rays() @ (down @ right @ NED_FROM_CAMERA).T, -1, 0)
    azimuth = np.degrees(np.arctan2(east, north)) % 360
    elevation = np.degrees(np.arctan2(below, np.hypot(north, east)))
    columns, rows = (8 * azimuth).astype(np.float32), (8 * elevation).astype(np.float32)
    seen = cv2.remap(GROUND, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
    return np.where(elevation > 0, seen, np.uint8(200))[..., None].repeat(3, axis=-1)


def leg(picture):
    """A dark bar that comes in from the lower left."""
    return cv2.line(picture, (-10, 275), (120, 170), (30, 32, 35), 36)


def text(picture):
    for width, level in ((5, 0), (1, 255)):
        cv2.putText(
            picture, "BAT 15.2V 1842mAh", (20, 30), cv2.FONT_HERSHEY_SIMPLEX, 0.8, (level,) * 3, width
        )
    return picture


def looked_at(turns, drawn=lambda picture: picture, shown=None):
    still = StillParts(CAMERA, shown)
    for pitch_deg, yaw_deg in turns:
        still.add(np.ascontiguousarray(drawn(view(pitch_deg, yaw_deg))), attitude(pitch_deg, yaw_deg))
    return still.found()


def where(drawn):
    """What is drawn, a pixel and a half away from its edge."""
    changed = drawn(np.full((270, 480, 3), 127, np.uint8))[..., 0] != 127
    return cv2.erode(changed.astype(np.uint8), np.ones((3, 3))) > 0


@pytest.mark.parametrize("turns", [PANS, NODS], ids=["pan", "nod"])
@pytest.mark.parametrize("drawn", [leg, text])
def test_what_belongs_to_the_drone_or_was_drawn_is_found(turns, drawn):
    found = looked_at(turns, drawn)
    hidden = where(drawn)
    assert (~found.shown)[hidden].mean() > 0.99
    around = cv2.dilate(hidden.astype(np.uint8), np.ones((41, 41))) > 0
    assert found.shown[~around].all()
    assert found.share == pytest.approx((~found.shown).mean())


@pytest.mark.parametrize("turns", [PANS, NODS], ids=["pan", "nod"])
def test_a_horizon_stays_where_it_is_while_the_camera_pans_and_is_no_part_of_the_drone(turns):
    assert looked_at(turns) is None


def test_without_turns_nothing_is_told():
    """However far away it is, all stands still then."""
    assert looked_at([(10.0, 0.02 * step) for step in range(60)], leg) is None


def test_a_few_turns_tell_nothing():
    assert looked_at(PANS[:FEWEST], leg) is None  # of the first nobody knows what was before it
    assert looked_at(PANS[: FEWEST + 1], leg) is not None


def test_what_a_mask_hides_already_is_not_told_again():
    masked = cv2.erode((~where(leg)).astype(np.uint8), np.ones((31, 31))) > 0
    assert looked_at(PANS, leg, masked) is None


def test_attitudes_that_turn_while_the_camera_does_not_tell_nothing():
    """Those of a drone beneath whose gimbal the camera stands still: all of the picture would belong to it."""
    still = StillParts(CAMERA)
    for pitch_deg, yaw_deg in PANS:
        still.add(view(20.0, 0.0), attitude(pitch_deg, yaw_deg))
    assert still.found() is None


def test_rotations_to_other_axes_tell_no_turn():
    """As of turns that were put together anew after each fourth picture: of each four three count."""
    counted = [StillParts(CAMERA), StillParts(CAMERA)]
    for index, (pitch_deg, yaw_deg) in enumerate(PANS[:24]):
        turned = cv2.Rodrigues(np.radians([0.0, 50.0 * (index // 4), 0.0]))[0]
        for still, axes in zip(counted, (index // 4, index), strict=True):
            still.add(leg(view(pitch_deg, yaw_deg)), turned @ attitude(pitch_deg, yaw_deg), axes)
    assert [still._count for still in counted] == [18, 0]


def test_still_dots_all_over_the_picture_are_no_part_of_a_drone():
    """They leave nothing between them that they do not enclose."""

    def dotted(picture):
        picture[(ROWS % 18 < 3) & (COLUMNS % 18 < 3)] = 255
        return picture

    assert looked_at(PANS, dotted) is None
