import cv2
import numpy as np
import pytest

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.flight.records import GyroscopeTrack
from flightdepth.flight.steadiness import (
    MAX_REPORTED_RAD,
    MAX_TURN_RAD,
    Steadiness,
    TurnRate,
    follow,
    small_camera,
    small_grey,
    verdict,
)
from flightdepth.runtimes.lens import undistort

CAMERA = Camera.from_fov(320, 192, 64.0)
STEP_NS = 33_366_667  # 29.97 frames/s


def texture(seed=0):
    noise = np.random.default_rng(seed).uniform(0, 255, (192 * 2, 320 * 2, 3)).astype(np.float32)
    smooth = sum(cv2.GaussianBlur(noise, (0, 0), sigma) * sigma for sigma in (2, 5, 12))
    return cv2.normalize(smooth, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)


TEXTURE = texture()


def view(warp):
    """The texture's middle, seen through a homography of picture coordinates (from the unmoved picture's)."""
    centred = np.array([[1, 0, -160], [0, 1, -96], [0, 0, 1.0]])
    return cv2.warpPerspective(TEXTURE, warp @ centred, (320, 192))


def panned(yaw_rad):
    """The picture after the camera turned right."""
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    now_from_before = np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])
    return view(CAMERA.matrix @ now_from_before @ np.linalg.inv(CAMERA.matrix))


def shifted(pixels):
    """The picture after the camera flew sideways along a wall that it faces."""
    return view(np.array([[1, 0, -pixels], [0, 1, 0], [0, 0, 1.0]]))


def zoomed(factor):
    """The picture after the camera flew straight at a wall."""
    return view(np.array([[factor, 0, 159.5 * (1 - factor)], [0, factor, 95.5 * (1 - factor)], [0, 0, 1.0]]))


def judge(pictures, gyroscope=None, step_ns=STEP_NS):
    steadiness = Steadiness(CAMERA, gyroscope)
    return [steadiness.add(index * step_ns, picture) for index, picture in enumerate(pictures)]


def test_a_hovering_camera_is_steady():
    rates = judge([panned(0)] * 6)
    assert all(rate.usable and rate.rad_s < 1e-3 for rate in rates)


@pytest.mark.parametrize("direction", [1, -1])
def test_a_pan_is_unusable_and_its_rate_is_told(direction):
    last = judge([panned(direction * 0.015 * k) for k in range(6)])[-1]
    assert not last.usable
    assert last.rad_s == pytest.approx(0.015 / 0.0333667, rel=0.15)
    assert "degrees" in last.reason


def test_points_of_what_is_masked_are_not_followed():
    """Burned-in text has the sharpest corners of all, and says of each pan that nothing turns."""
    text = np.random.default_rng(1).integers(0, 2, (24, 80)).repeat(4, 0).repeat(4, 1).astype(np.uint8) * 255
    shown = np.ones((192, 320), np.bool_)
    shown[:96] = False

    def with_text(picture):
        picture = picture.copy()
        picture[:96] = text[..., None]
        return picture

    rates = []
    for each in (None, shown):
        steadiness = Steadiness(CAMERA, shown=each)
        rates += [[steadiness.add(k * STEP_NS, with_text(panned(0.015 * k))) for k in range(6)][-1]]
    assert rates[0].usable
    assert not rates[1].usable
    assert rates[1].rad_s == pytest.approx(0.015 / 0.0333667, rel=0.15)


def test_corners_beside_what_is_masked_are_not_those_of_its_edge():
    """Where the mask ended with the letters, nine in ten of the points were beside them, and stood still."""
    letters = np.zeros((192, 320), np.uint8)
    for y in range(16, 192, 48):
        cv2.putText(letters, "BAT 15.2V 1842mAh LQ 98 GPS 14", (4, y), cv2.FONT_HERSHEY_SIMPLEX, 0.7, 255, 2)
    hidden = letters > 0
    before, after = (np.where(hidden, 255, panned(yaw_rad)[..., 0]).astype(np.uint8) for yaw_rad in (0, 0.03))
    start, end, _ = follow(before, after, ~hidden)
    moved_px = np.linalg.norm(end - start, axis=1)
    assert len(start) >= 20
    assert np.mean(moved_px < 1) < 0.1


def test_flying_at_a_wall_is_steady():
    assert all(rate.usable for rate in judge([zoomed(1.01**k) for k in range(8)]))


def test_flying_along_a_wall_is_steady():
    assert all(rate.usable for rate in judge([shifted(1.5 * k) for k in range(8)]))


def test_a_pan_is_over_one_pair_after_it_stops():
    rates = judge([panned(0.015 * min(k, 5)) for k in range(12)])
    assert not rates[5].usable
    assert all(rate.usable for rate in rates[8:])


def test_a_cut_is_unusable():
    last = judge([panned(0)] * 4 + [texture(seed=9)[:192, :320]])[-1]
    assert not last.usable


def test_the_first_picture_is_usable():
    assert judge([panned(0)])[0].usable


def test_a_picture_without_texture_cannot_be_judged():
    last = judge([np.full((192, 320, 3), 90, np.uint8)] * 3)[-1]
    assert last.usable
    assert np.isnan(last.rad_s)
    assert "texture" in last.reason


def test_without_texture_the_gyroscope_tells():
    gyroscope = GyroscopeTrack(np.arange(200) * 2_500_000, np.tile([0.0, 0.3, 0.0], (200, 1)))
    last = judge([np.full((192, 320, 3), 90, np.uint8)] * 5, gyroscope)[-1]
    assert not last.usable
    assert last.rad_s == pytest.approx(0.3)
    assert "gyroscope" in last.reason


def test_with_texture_the_pictures_tell_because_they_may_be_stabilised():
    gyroscope = GyroscopeTrack(np.arange(200) * 2_500_000, np.tile([0.0, 0.3, 0.0], (200, 1)))
    assert judge([panned(0)] * 5, gyroscope)[-1].usable


def test_the_rate_does_not_depend_on_the_frame_rate():
    slow = judge([panned(0.02 * k) for k in range(5)], step_ns=50_000_000)[-1]
    fast = judge([panned(0.01 * k) for k in range(9)], step_ns=25_000_000)[-1]
    assert slow.rad_s == pytest.approx(fast.rad_s, rel=0.15)


def test_the_limit_is_half_a_degree_or_so_in_a_pair():
    assert verdict(MAX_TURN_RAD, 0.1, "the picture").usable
    assert not verdict(1.01 * MAX_TURN_RAD, 0.1, "the picture").usable


def test_stamps_must_rise():
    with pytest.raises(BadInput, match="stamp"):
        judge([panned(0)] * 2, step_ns=0)


def test_a_picture_of_another_size_is_refused():
    with pytest.raises(BadInput, match="320x192"):
        judge([np.zeros((100, 320, 3), np.uint8)])


def test_corners_are_followed_to_where_they_went():
    before = cv2.cvtColor(shifted(0), cv2.COLOR_RGB2GRAY)
    after = cv2.cvtColor(shifted(4), cv2.COLOR_RGB2GRAY)
    start, end, found = follow(before, after)
    assert len(start) > 0.8 * found
    assert np.median(end - start, axis=0) == pytest.approx([-4, 0], abs=0.05)


@pytest.mark.parametrize(
    ("step_ns", "steps"),
    [(STEP_NS, 3), (55_000_000, 2), (56_000_000, 1), (500_000_000, 1)],
    ids=["three at 29.97 a second", "two in 0.11 s", "one in 0.056 s", "one in 0.5 s"],
)
def test_a_picture_is_followed_from_one_a_tenth_of_a_second_before_or_else_the_one_before(step_ns, steps):
    """Pixels are those of the small picture: of 4 pixels a step half."""
    followed = []
    steadiness = Steadiness(CAMERA, on_followed=lambda *pair: followed.append(pair))
    for k in range(6):
        steadiness.add(k * step_ns, shifted(4 * k))
    start, end, before_ns, after_ns = followed[-1]
    assert (before_ns, after_ns) == ((5 - steps) * step_ns, 5 * step_ns)
    assert np.median(end - start, axis=0) == pytest.approx([-2 * steps, 0], abs=0.05)


def dotted(count):
    """`count` dots on black, each a corner."""
    picture = np.zeros((192, 320, 3), np.uint8)
    for k in range(count):
        cv2.circle(picture, (20 + 30 * (k % 10), 20 + 30 * (k // 10)), 4, (255, 255, 255), -1)
    return picture


@pytest.mark.parametrize(("count", "told"), [(15, False), (40, True)])
def test_a_few_corners_are_too_little_texture(count, told):
    last = judge([dotted(count)] * 3)[-1]
    assert np.isfinite(last.rad_s) == told
    assert ("texture" in last.reason) != told


def test_after_a_cut_nothing_is_followed():
    last = judge([panned(0)] * 4 + [texture(seed=9)[:192, :320]])[-1]
    assert np.isnan(last.rad_s)
    assert "too fast to be followed" in last.unusable


def test_of_points_in_pictures_of_different_things_hardly_any_come_home():
    before, after = (texture(seed)[:192, :320, 0] for seed in (0, 9))
    start, _, found = follow(before, after)
    assert len(start) < 0.15 * found


def test_a_reason_tells_the_angle_the_time_and_who_says_so():
    told = verdict(np.radians(2), 0.1, "the gyroscope")
    assert told.unusable == told.reason == "turns 2.0 degrees in 0.10 s, says the gyroscope"
    assert told.rad_s == pytest.approx(np.radians(20))


def test_what_cannot_be_told_is_no_reason_against_depth():
    assert TurnRate(np.nan, True, "too little texture").unusable is None


@pytest.mark.parametrize("pictures", ["textured", "blank"])
def test_a_larger_turn_may_be_allowed(pictures):
    """As where each pair's rotation is taken out."""
    views = [
        panned(0.015 * k) if pictures == "textured" else np.zeros((192, 320, 3), np.uint8) for k in range(6)
    ]
    gyroscope = GyroscopeTrack(np.arange(200) * 2_500_000, np.tile([0.0, 0.3, 0.0], (200, 1)))
    steadiness = Steadiness(CAMERA, gyroscope)
    last = [steadiness.add(k * STEP_NS, view, MAX_REPORTED_RAD) for k, view in enumerate(views)][-1]
    assert last.usable
    assert last.rad_s > 0.25


def test_turns_are_judged_through_the_lens_as_it_zooms():
    """Of a flight that began at half the focal length."""
    wide = Camera(320, 192, CAMERA.fx / 2, CAMERA.fy / 2, CAMERA.cx, CAMERA.cy)
    steadiness = Steadiness(wide)
    steadiness.see_through(CAMERA)
    views = [panned(0.01 * k) for k in range(4)]
    found = [steadiness.add(k * STEP_NS, view, MAX_REPORTED_RAD) for k, view in enumerate(views)]
    assert found[-1].rad_s == pytest.approx(0.01 * 1e9 / STEP_NS, rel=0.03)


def test_a_panorama_is_followed_in_one_row_at_least():
    small = small_camera(Camera.from_fov(4000, 8, 60.0))
    assert (small.width, small.height) == (160, 1)


@pytest.mark.parametrize(("colour", "grey"), [((255, 0, 0), 76), ((0, 255, 0), 150), ((0, 0, 255), 29)])
def test_red_green_and_blue_are_as_bright_as_they_look(colour, grey):
    assert (small_grey(np.full((192, 320, 3), colour, np.uint8), small_camera(CAMERA)) == grey).all()


def test_a_picture_of_another_width_is_refused():
    with pytest.raises(BadInput, match="expected 320x192, got 100x192"):
        judge([np.zeros((192, 100, 3), np.uint8)])


@pytest.mark.parametrize("camera", [CAMERA, Camera(320, 192, 250, 251, 150, 99, (-0.2, 0.05, 0.001, 0.0))])
def test_normalised_points_project_back(camera):
    pixels = np.array([[10.0, 20.0], [160.0, 96.0], [300.0, 150.0]])
    rays = np.c_[undistort(pixels, camera), np.ones(3)]
    back, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), camera.matrix, np.array(camera.distortion))
    assert np.allclose(back[:, 0], pixels, atol=1e-2)


def test_normalised_fisheye_points_project_back():
    camera = Camera(320, 192, 150, 150, 159.5, 95.5, (0.05, -0.01, 0.0, 0.0), "fisheye")
    pixels = np.array([[10.0, 20.0], [160.0, 96.0], [300.0, 150.0]])
    plane = undistort(pixels, camera).reshape(-1, 1, 2)
    back = cv2.fisheye.distortPoints(plane, camera.matrix, np.array(camera.distortion))
    assert np.allclose(back[:, 0], pixels, atol=1e-3)
