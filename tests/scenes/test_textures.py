import cv2
import numpy as np
import pytest

from flightdepth.errors import BadInput
from flightdepth.scenes import Textures, chance, textures, textures_from_folder
from flightdepth.scenes.procedural import dead_leaves, fractal_noise, texture
from flightdepth.scenes.textures import EDGE, PYRAMID_TEXELS


def test_a_pyramid_ends_in_the_mean_light():
    half = np.zeros((EDGE, EDGE, 3), np.uint8)
    half[:, : EDGE // 2] = 255
    last = Textures.from_images([half]).texels[0, -1]
    np.testing.assert_array_equal(last, round(255 * 0.5 ** (1 / 2.2)))


def test_one_colour_stays_on_every_level():
    texels = Textures.from_images([np.full((40, 30, 3), 77, np.uint8)]).texels
    assert texels.shape == (1, PYRAMID_TEXELS, 3)
    assert np.abs(texels.astype(int) - 77).max() <= 1


def test_the_central_square_is_taken():
    wide = np.zeros((100, 300, 3), np.uint8)
    wide[:, 100:200] = 200
    assert (Textures.from_images([wide]).texels == 200).mean() > 0.97


def test_digest_is_of_the_content():
    one, two = (Textures.from_images([np.full((9, 9, 3), value, np.uint8)]) for value in (1, 2))
    assert one.digest != two.digest
    assert one.digest == Textures.from_images([np.full((9, 9, 3), 1, np.uint8)]).digest


def test_a_folder_is_read_in_the_order_of_names(tmp_path):
    (tmp_path / "sub").mkdir()
    for name, value in (("sub/z.png", 30), ("a.png", 10), ("b.jpg", 20)):
        cv2.imwrite(str(tmp_path / name), np.full((8, 8, 3), (0, 0, value), np.uint8))  # BGR: red
    texels = textures_from_folder(tmp_path).texels
    assert texels[:, 0, 0].tolist() == [10, 20, 30]
    assert texels[0, 0].tolist() == [10, 0, 0]


def test_made_ones_follow_the_photos(tmp_path):
    cv2.imwrite(str(tmp_path / "a.png"), np.full((8, 8, 3), 40, np.uint8))
    texels = textures_from_folder(str(tmp_path), made=2, seed=3).texels  # as docs/stillbox.md has it
    assert texels[0, 0].tolist() == [40, 40, 40]
    np.testing.assert_array_equal(texels[1:], Textures.procedural(2, 3).texels)


def test_more_than_memory_holds_are_refused_before_any_is_read(tmp_path, monkeypatch):
    for name in "ab":
        (tmp_path / f"{name}.png").write_bytes(b"no image")
    monkeypatch.setattr(textures, "memory_bytes", lambda: 2e6)
    with pytest.raises(BadInput, match="at most 1: each takes 1 MB of memory, got 2"):
        textures_from_folder(tmp_path)


def test_a_folder_without_images_is_refused(tmp_path):
    with pytest.raises(BadInput, match="at least one image"):
        textures_from_folder(tmp_path)


def test_a_file_that_is_no_image_is_named(tmp_path):
    (tmp_path / "broken.png").write_bytes(b"no image")
    with pytest.raises(BadInput, match=r"broken\.png"):
        textures_from_folder(tmp_path)


def test_half_a_photo_is_named(tmp_path):
    """It was taken, half of it grey."""
    whole = cv2.imencode(".jpg", np.random.default_rng(0).integers(0, 256, (64, 64, 3), np.uint8))[
        1
    ].tobytes()
    (tmp_path / "a.jpg").write_bytes(whole)
    (tmp_path / "b.jpg").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(BadInput, match=r"b\.jpg: expected a whole image .*, got a damaged one"):
        textures_from_folder(tmp_path)


@pytest.mark.parametrize("number", range(4))
def test_a_procedural_texture_is_its_seed_s(number):
    one = texture(3, number, 64)
    np.testing.assert_array_equal(one, texture(3, number, 64))
    assert not np.array_equal(one, texture(4, number, 64))


@pytest.mark.parametrize("number", range(4))
def test_each_kind_has_contrast_and_detail(number):
    grey = texture(3, number, 128).astype(float).mean(axis=2)
    assert grey.std() > 4
    assert np.abs(np.diff(grey, axis=1)).mean() > 1


def leaf_by_leaf(rng, edge):
    """Dead leaves one at a time, with all sums of a leaf where it is drawn."""
    centre = rng.uniform(50, 190) + rng.uniform(5, 55) * rng.uniform(-1, 1, 3)
    spread = rng.uniform(15, 90)
    light, tint = rng.uniform(-1, 1, (64, 1)) * spread, rng.uniform(-1, 1, (64, 3)) * spread
    colours = np.clip(centre + light + tint * rng.uniform(0.2, 0.9), 5, 250).astype(np.float32)
    image = np.tile(colours[0], (edge, edge, 1))
    smallest, largest = edge / 170, edge / rng.uniform(3, 9)
    for _ in range(int(rng.integers(1500, 4000))):
        u = rng.random()
        radius = 1 / np.sqrt((1 - u) / smallest**2 + u / largest**2)
        colour = colours[rng.integers(64)].tolist()
        centre, corners = rng.uniform(0, edge, 2), int(rng.choice([3, 4, 4, 24]))
        angle = rng.uniform(0, 2 * np.pi) + np.arange(corners) * (2 * np.pi / corners)
        circle = np.stack([np.cos(angle), np.sin(angle) * rng.uniform(0.35, 1.0)])
        turn = rng.uniform(0, np.pi)
        turned = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ circle
        points = np.rint((centre + radius * turned.T) * 16).astype(np.int32)
        cv2.fillPoly(image, [points], colour, cv2.LINE_AA if radius < 6 else cv2.LINE_8, shift=4)
    return image


@pytest.mark.parametrize("number", range(3))
def test_leaves_are_those_drawn_one_by_one(number):
    """A seed's texture stays what it was: fixed test sets are dressed in it."""
    found, expected = (draw(chance.stream(7, number), 128) for draw in (dead_leaves, leaf_by_leaf))
    same = (found == expected).all(axis=2)
    assert same.mean() > 0.9999  # a corner between two sixteenths of a pixel may fall on either side


def test_textures_are_in_the_order_of_their_numbers():
    texels = Textures.procedural(9, 3).texels[:, : EDGE * EDGE]
    for number in range(9):
        np.testing.assert_array_equal(texels[number].reshape(EDGE, EDGE, 3), texture(3, number, EDGE))


def test_a_texture_that_cannot_be_made_stops_all():
    whole = np.full((8, 8, 3), 9, np.uint8)

    def image(number):
        if number == 3:
            raise BadInput("texture 3", expected="an image", got="none")
        return whole

    with pytest.raises(BadInput, match="texture 3"):
        Textures.made(8, image)


@pytest.mark.parametrize("exponent", [0.7, 1.0, 1.5])
def test_noise_has_the_spectrum_it_is_asked_for(exponent):
    noise = fractal_noise(np.random.default_rng(0), 256, exponent)
    frequency = np.hypot(np.fft.fftfreq(256)[:, None], np.fft.rfftfreq(256)[None, :])
    amplitude, inner = np.abs(np.fft.rfft2(noise)), (frequency > 0.02) & (frequency < 0.45)
    slope = np.polyfit(np.log(frequency[inner]), np.log(amplitude[inner]), 1)[0]
    assert slope == pytest.approx(-exponent, abs=0.05)
    assert noise.mean() == pytest.approx(0, abs=1e-5)
    assert noise.std() == pytest.approx(1, rel=1e-4)


def test_texels_of_another_shape_are_refused():
    with pytest.raises(ValueError, match="expected uint8"):
        Textures(np.zeros((1, 5, 3), np.uint8))
