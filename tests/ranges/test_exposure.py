"""Pictures whose exposure changed, through tone curves of their standards; rooms, turns, bare pictures, a flight."""

import cv2
import numpy as np
import pytest

from flightdepth.camera import Camera
from flightdepth.ranges import MultiRangeEstimator
from flightdepth.ranges.exposure import ExposedFrames, exposed_as, tone_line
from flightdepth.ranges.pairs import Baselines, Frame
from flightdepth.renderers.raycast import render
from flightdepth.runtimes.network import load_network
from flightdepth.stillbox import PairRule, Picture, TestSet
from flightdepth.stillbox.motion_noise import rotated

LEVELS = np.arange(256) / 255
LINEAR = np.where(LEVELS <= 0.04045, LEVELS / 12.92, ((LEVELS + 0.055) / 1.055) ** 2.4)  # IEC 61966-2-1
FRAME_NS = 100_000_000


def rooms(shift, *, width=256):
    return TestSet(Picture(width, width, width), PairRule(shift), scenes=6)


def brightened(image, stops):
    """As sRGB shows so many stops more light."""
    light = np.minimum(LINEAR * 2.0**stops, 1)
    encoded = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return cv2.LUT(image, np.rint(255 * encoded).astype(np.uint8))


def raised(image, levels):
    """As a logarithmic profile shows more light."""
    return cv2.LUT(image, np.clip(np.arange(256.0) + levels, 0, 255).astype(np.uint8))


def camera_of(pair):
    return Camera.from_fov(*pair.current.shape[1::-1], 90)


def levels_off(image, wanted):
    """On average, of what is not as bright as can be in either."""
    shown = (wanted < 250) & (image < 250)
    return np.abs(image[shown].astype(float) - wanted[shown]).mean()


@pytest.mark.parametrize("shift", [3, 9, 15])
def test_without_a_change_pictures_stay_as_they_are(shift):
    """Up to five times the nominal displacement, where each shows much that the other does not."""
    for pair in rooms(shift):
        assert exposed_as(pair.previous, pair.current, camera_of(pair)) is pair.previous


def test_what_is_made_brighter_is_not_rounded():
    """A line through levels: of 128 neighbouring ones none is left out, as there would be among whole ones."""
    pair = next(iter(rooms(3)))
    found = exposed_as(pair.previous, brightened(pair.current, 0.5), camera_of(pair))
    middle = (pair.previous > 50) & (pair.previous < 150)
    levels = pair.previous[middle].astype(float)
    line = np.polyfit(levels, found[middle], 1)
    assert np.abs(np.polyval(line, levels) - found[middle]).max() < 0.01
    assert line[0] > 1.1


@pytest.mark.parametrize("stops", [-1, -0.5, 0.25, 0.5, 1])
def test_a_change_of_exposure_is_made_up_for(stops):
    for pair in rooms(3):
        found = exposed_as(pair.previous, brightened(pair.current, stops), camera_of(pair))
        wanted = brightened(pair.previous, stops)
        assert levels_off(found, wanted) < 1.5
        assert levels_off(found, wanted) < 0.15 * levels_off(pair.previous, wanted)


def test_so_is_one_of_a_logarithmic_profile():
    for pair in rooms(3):
        previous, current = (cv2.LUT(image, np.linspace(60, 180, 256).astype(np.uint8)) for image in
                             (pair.previous, pair.current))  # fmt: skip
        found = exposed_as(previous, raised(current, 20), camera_of(pair))
        assert levels_off(found, raised(previous, 20)) < 1.0


def test_a_known_turn_is_undone_first():
    turn = np.radians([0.0, 12.0, 0.0])
    for pair in rooms(3):
        camera = camera_of(pair)
        previous = rotated(pair.previous, camera, turn)
        current_from_previous = cv2.Rodrigues(turn)[0]
        found = exposed_as(
            previous, brightened(pair.current, 0.5), camera, current_from_previous, np.radians(12.0)
        )
        assert levels_off(found, brightened(previous, 0.5)) < 2.5


def test_a_picture_of_one_brightness_tells_a_factor():
    grey, brighter = (np.full((128, 192, 3), level, np.uint8) for level in (100, 130))
    found = exposed_as(grey, brighter, Camera.from_fov(192, 128, 90))
    assert np.array_equal(found, brighter)
    blocks = [image[:8, :8, 0].astype(float) for image in (grey, brighter)]
    assert tone_line(*blocks, np.ones((8, 8), bool)) == pytest.approx((1.3, 0.0), abs=1e-9)


def test_what_a_turn_brought_into_view_is_not_compared():
    """To the left by 50 of 90 degrees: what lies more than 5 degrees to the right was seen before, nothing else."""
    before, turn = np.full((128, 192, 3), 100, np.uint8), np.radians([0.0, 50.0, 0.0])
    now = before.copy()
    now[:, : round(96 * (1 + np.tan(np.radians(5))))] = 200
    found = exposed_as(before, now, Camera.from_fov(192, 128, 90), cv2.Rodrigues(turn)[0], np.radians(50))
    assert found is before


@pytest.mark.parametrize(("rows", "told"), [(7, False), (8, True)])
def test_fewer_than_64_blocks_of_the_scene_tell_nothing(rows, told):
    grey, brighter = (np.full((128, 192, 3), level, np.uint8) for level in (100, 130))
    shown = np.zeros((32, 48), bool)
    shown[: 2 * rows, :16] = True  # 8 blocks across
    found = exposed_as(grey, brighter, Camera.from_fov(192, 128, 90), shown=shown)
    assert (found is not grey) == told


@pytest.mark.parametrize("level", [0, 255])
def test_black_and_white_tell_nothing(level):
    grey, bare = np.full((128, 192, 3), 100, np.uint8), np.full((128, 192, 3), level, np.uint8)
    assert exposed_as(grey, bare, Camera.from_fov(192, 128, 90)) is grey


def test_each_frame_of_a_flight_is_shown_once_with_all_that_is_known_of_it():
    """Its turn, its mask and its lens: as `exposed_as` shows it, with its own number and time."""
    pair, turn = next(iter(rooms(3))), np.radians([0.0, 12.0, 0.0])
    camera, shown = camera_of(pair), np.ones((64, 64), bool)
    shown[:, 24:] = False
    previous = rotated(pair.previous, camera, turn)
    current = brightened(pair.current, 0.5)
    current[:, 96:] = previous[:, 96:] = 180
    turns = np.stack([np.eye(3), cv2.Rodrigues(turn)[0]])
    frames = (Frame(3, 30, pair.previous), Frame(4, 40, previous))
    nothing = np.zeros((2, 3)), np.zeros(2), np.zeros(2)
    lines = Baselines(frames, *nothing, turns, np.radians([0.0, 12.0]), *np.ones((2, 2), bool), None)
    exposed = ExposedFrames(lines, current, camera, shown, evened=lambda image: image // 2)
    found = exposed[1]
    assert (found.index, found.stamp_ns) == (4, 40)
    assert exposed[1] is found
    wanted = exposed_as(previous // 2, current, camera, turns[1], np.radians(12.0), shown=shown)
    np.testing.assert_array_equal(found.image, wanted)
    bare = exposed_as(previous // 2, current, camera, shown=shown)
    whole = exposed_as(previous // 2, current, camera, turns[1], np.radians(12.0))
    assert not np.array_equal(bare, wanted) and not np.array_equal(whole, wanted)


def test_a_flight_bears_a_camera_that_sets_its_exposure():
    """The last picture is a stop brighter; that costs less than half of the error again."""
    errors, network = {0: [], 1: []}, load_network("motion-tiny", threads=1)
    for number in range(3):
        scene, textures, camera, _ = rooms(3).drawn(number)
        frames = range(8)
        seen = render(scene, textures, camera, frames=frames)
        for stops, found in errors.items():
            estimator = MultiRangeEstimator(network, camera, ranges=1)
            for frame in frames:
                stamp_ns, moved_m = frame * FRAME_NS, scene.displacement(frame, frame + 1)
                estimator.add_velocity(stamp_ns, moved_m / (FRAME_NS * 1e-9), frame="camera")
                image = brightened(seen.images[frame], stops * (frame == frames[-1]))
                result = estimator.add_frame(stamp_ns, image)
            found.append(np.nanmedian(np.abs(result.depth_m / seen.depth_m[-1] - 1)))
    assert np.mean(errors[1]) < 1.5 * np.mean(errors[0])
