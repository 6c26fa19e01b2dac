from collections import Counter

import numpy as np
import pytest

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.scenes import StillBoxConfig, Textures
from flightdepth.stillbox import PairRule, PairStream, Picture, stream
from flightdepth.stillbox.stream import CHUNK

CONFIG = StillBoxConfig(meshes=(2, 4))
CAMERA = Camera.from_fov(16, 16, 90)
TEXTURES = Textures.from_images(np.random.default_rng(0).integers(0, 256, (2, 32, 32, 3), dtype=np.uint8))
SMALL = Picture(16, 16, 16)


def opened(picture=SMALL, seed=5, **options) -> PairStream:
    options = {"pool_scenes": 16, "pairs_per_scene": 3} | options
    return PairStream(CONFIG, TEXTURES, picture, PairRule(), seed, **options)


def same(a, b) -> bool:
    names = ("previous", "current", "target_m", "displacement")
    return all(
        getattr(mine, name).tobytes() == getattr(yours, name).tobytes()
        for mine, yours in zip(a.each, b.each, strict=True)
        for name in names
    )


def batches(start: int, count: int, **options):
    with opened(**options) as pairs:
        return [pairs.batch(start + 10 * n, 10) for n in range(count)]


def test_camera_effects_come_to_a_share_of_the_pairs():
    def pairs(**options):
        return np.concatenate([batch.pairs for batch in batches(0, 30, **options)])

    clean, all_of_them, some = (
        pairs(),
        pairs(photometric_share=1.0),
        pairs(photometric_share=0.3),
    )
    touched, most = ((each != clean).any((1, 2, 3)).mean() for each in (some, all_of_them))
    assert most > 0.9
    assert touched / most == pytest.approx(0.3, abs=0.08)


def test_the_same_seed_gives_the_same_bytes():
    assert all(map(same, batches(0, 6), batches(0, 6)))


def test_another_seed_gives_other_pairs():
    assert not same(batches(0, 1)[0], batches(0, 1, seed=6)[0])


def test_a_stream_resumed_at_an_index_goes_on_as_if_it_had_not_stopped():
    assert all(map(same, batches(0, 9)[6:], batches(60, 3)))


@pytest.mark.parametrize("threads", [1, 3])
def test_how_scenes_are_rendered_changes_nothing(threads):
    assert all(map(same, batches(0, 6), batches(0, 6, threads=threads)))


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_samples_do_not_depend_on_the_batch_size(share):
    whole, ten = batches(0, 2, photometric_share=share)
    with opened(photometric_share=share) as pairs:
        assert pairs.batch(13, 1).pairs.tobytes() == ten.pairs[3:4].tobytes()
    assert whole.pairs.shape == (10, 16, 16, 6)


def test_the_pool_is_bounded():
    with opened() as pairs:
        for n in range(12):
            pairs.batch(20 * n, 20)
            assert len(pairs._scenes) == 16


def test_each_scene_is_used_as_often_as_it_should_be(monkeypatch):
    used: Counter[int] = Counter()

    def remember(scene, rendered, camera, *_):
        used[scene.number] += 1
        blank = np.zeros((16, 16, 3), np.uint8)
        return stream.Pair(blank, blank, np.zeros((16, 16), np.float32), np.zeros(3), camera)

    class Numbered:
        frames = 10

        def __init__(self, number):
            self.number = number

    monkeypatch.setattr(stream, "make_pair", remember)
    monkeypatch.setattr(PairStream, "_render", lambda self, number: (Numbered(number), None, CAMERA))
    with opened(pairs_per_scene=40) as pairs:
        pairs.batch(0, 40 * CHUNK * 12)
    steady = np.array([used[number] for number in range(16, 12 * CHUNK)])  # left the pool, entered it singly
    assert steady.mean() == pytest.approx(40, rel=0.04)
    assert steady.min() > 15
    assert steady.max() < 75


def test_new_scenes_come_as_old_ones_leave():
    first, last = batches(0, 1)[0], batches(CHUNK * 3 * 4, 1)[0]
    colours = [set(map(bytes, batch.pairs.reshape(-1, 6))) for batch in (first, last)]
    assert len(colours[0] & colours[1]) < 0.2 * len(colours[0])


def test_an_error_in_rendering_reaches_who_asks_for_the_batch(monkeypatch):
    def broken(*_, **__):
        raise MemoryError("no room for the scene")

    monkeypatch.setattr(stream, "render", broken)
    with opened() as pairs, pytest.raises(MemoryError, match="no room"):
        pairs.batch(0, 4)


def test_crops_of_a_larger_picture():
    with opened(picture=Picture(24, 16, 40)) as pairs:
        batch = pairs.batch(0, 20)
    assert batch.pairs.shape == (20, 16, 24, 6)
    assert batch.target_m.shape == (20, 16, 24)


def test_a_crop_has_the_focal_length_of_the_whole():
    camera = Picture(24, 16, 40).camera(CONFIG.horizontal_fov_deg, 5, 7)
    assert (camera.width, camera.height) == (24, 16)
    assert camera.fx == camera.fy == pytest.approx(20)
    assert (camera.cx, camera.cy) == pytest.approx((14.5, 12.5))


def test_all_eight_symmetries_are_drawn():
    with opened(pairs_per_scene=60) as pairs:
        moves = np.array([pair.displacement for pair in pairs.batch(0, 400).each])
    signs = {tuple(row) for row in np.sign(moves[np.linalg.norm(moves, axis=1) > 0, :2])}
    assert signs == {(-1, -1), (-1, 1), (1, -1), (1, 1)}


@pytest.mark.parametrize("scenes", [0, 4, 20])
def test_a_pool_that_is_no_whole_number_of_chunks_is_refused(scenes):
    with pytest.raises(BadInput, match="multiple of 8"):
        opened(pool_scenes=scenes)


def test_camera_effects_are_refused_where_the_noise_does_not_cover_the_picture():
    with pytest.raises(BadInput, match="camera effects: expected at most 1024 px, got 1920 px"):
        opened(Picture(1920, 1080, 1920), photometric_share=1.0)


@pytest.mark.parametrize("size", [(65, 64, 64), (64, 65, 64), (0, 4, 8)])
def test_a_crop_larger_than_the_picture_is_refused(size):
    with pytest.raises(BadInput, match="picture size"):
        Picture(*size)


def test_scenes_in_the_open_stand_upright_where_asked():
    def turns(**options):
        """Numbers of open pairs whose sky is above, and elsewhere; its horizon is always far brighter than nothing."""
        pairs = PairStream(
            StillBoxConfig(open_share=1.0, meshes=(0, 0)),
            TEXTURES,
            SMALL,
            PairRule(),
            5,
            pairs_per_scene=3,
            **options,
        )
        above, elsewhere = 0, 0
        with pairs:
            for pair in pairs.batch(0, 90).each:
                far = pair.target_m >= 99
                above += far[0].any() and not far[-1].any()
                elsewhere += far[-1].any() and not far[0].any()
        return above, elsewhere

    above, elsewhere = turns(upright=True)
    assert above > 0 and elsewhere == 0
    assert turns()[1] > 0


def test_rooms_are_turned_as_before_where_open_scenes_stand_upright():
    assert all(map(same, batches(0, 3), batches(0, 3, upright=True)))


def test_objects_drawn_for_a_lens_fill_its_picture_as_they_do_through_90_degrees():
    def covered(fov_deg, **options):
        """Mean share of pixels whose neighbour to the right is at another depth by a tenth."""
        picture = Picture(64, 64, 64, (fov_deg, fov_deg))
        rule = PairRule(reference_focal_px=32.0)
        with PairStream(StillBoxConfig(), TEXTURES, picture, rule, 5, pool_scenes=40, **options) as pairs:
            depths = [pair.target_m for pair in pairs.batch(0, 160).each]
        return np.mean([(abs(np.diff(np.log(each + 0.1), axis=1)) > 0.1).mean() for each in depths])

    usual, narrow = covered(90.0), covered(35.0)
    assert covered(90.0, objects_for_lens=True) == pytest.approx(usual)
    assert narrow < 0.7 * usual
    assert covered(35.0, objects_for_lens=True) == pytest.approx(usual, rel=0.25)
