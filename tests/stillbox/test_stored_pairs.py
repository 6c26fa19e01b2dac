"""Training pairs from a stored set."""

from dataclasses import replace

import numpy as np
import pytest
from small_sets import TEXTURES, as_rendered, render_small, small_source

from flightdepth.errors import BadInput
from flightdepth.stillbox import PairRule, Picture
from flightdepth.stillbox.stored import open_stored_set
from flightdepth.stillbox.stored_pairs import StoredPairs

SOURCE = small_source()
WHOLE = Picture(16, 12, 16)


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    """Seven scenes, without JPEG's losses in depth."""
    folder = tmp_path_factory.mktemp("pairs") / "set"
    render_small(folder, source=SOURCE)
    return open_stored_set(folder)


def opened(stored, *, picture=WHOLE, config=SOURCE.scenes.config, threads=2, seed=5):
    return StoredPairs(
        config, TEXTURES, picture, PairRule(), seed, pool_scenes=8, threads=threads, stored=stored
    )


def test_a_set_whose_camera_turns_is_not_one_of_steady_flights(tmp_path):
    turning = small_source(orientation_noise_rad=0.3)
    render_small(tmp_path / "turning", source=turning)
    stored = open_stored_set(tmp_path / "turning")
    with pytest.raises(BadInput, match="expected a camera that does not turn"):
        opened(stored)
    with opened(stored, config=turning.scenes.config) as stream:
        assert len(stream.stored) == 7


def same(one, other):
    arrays = ("previous", "current", "target_m", "displacement")
    return all(
        np.array_equal(getattr(mine, name), getattr(yours, name))
        for mine, yours in zip(one.each, other.each, strict=True)
        for name in arrays
    )


def test_scenes_come_in_a_new_order_each_time_round(stored):
    with opened(stored) as stream:
        rounds = [[stream._place(number) for number in range(first, first + 7)] for first in (0, 7, 14)]
    assert [sorted(each) for each in rounds] == [list(range(7))] * 3
    assert rounds[0] != rounds[1] != rounds[2]


def test_a_pair_is_one_of_the_set(stored):
    """Targets at 100 m or scaled from a frame's depth, displacements of whole steps."""
    with opened(stored) as stream:
        batch = stream.batch(0, 20)
    for pair in batch.each:
        target_m, steps = pair.target_m, np.linalg.norm(pair.displacement) / 0.1
        assert steps == pytest.approx(round(steps), abs=1e-6)
        assert round(steps) <= 2
        assert (target_m == 100).all() == (round(steps) == 0)
        assert pair.camera.fx == pytest.approx(8)


def test_depth_is_the_scenes(stored):
    """A crop of the second frame, times 3 / shift, seen in a mirror or upside down."""
    depths = [as_rendered(SOURCE, n)[1].depth_m for n in range(7)]
    crop = Picture(8, 8, 16)
    with opened(stored, picture=crop) as stream:
        scene, cut, camera = stream._render(3)
    whole = depths[stream._place(3)]
    y, x = (round(full - part) for full, part in ((5.5, camera.cy), (7.5, camera.cx)))
    assert np.array_equal(cut.depth_m, whole[:, y : y + 8, x : x + 8].clip(0.1, 200))
    assert cut.images.shape == (3, 8, 8, 3)
    assert scene.frames == 3


def test_a_stream_goes_on_as_if_it_had_never_stopped(stored):
    with opened(stored) as first, opened(stored, threads=1) as second:
        first.batch(0, 400)
        assert same(first.batch(400, 8), second.batch(400, 8))


def test_the_seed_decides(stored):
    with opened(stored) as first, opened(stored, seed=6) as second:
        assert not same(first.batch(0, 8), second.batch(0, 8))


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"picture": Picture(16, 12, 32)}, "width: expected 32 px, got 16 px"),
        ({"picture": Picture(16, 16, 16)}, "height: expected at least 16 px, got 12 px"),
        (
            {"config": small_source(horizontal_fov_deg=60).scenes.config},
            "field of view: expected 60.0, got 90.0",
        ),
        ({"config": small_source(speed_m_s=2).scenes.config}, r"step: expected 0\.200 m .*, got 0\.100 m"),
        ({"picture": Picture(16, 12, 16, (55, 120))}, "a stage of one field of view, got"),
        ({"config": small_source(open_share=0.5).scenes.config}, "a stage of closed rooms, got 0.5"),
    ],
)
def test_a_set_of_another_kind_is_refused(stored, changes, said):
    with pytest.raises(BadInput, match=said):
        opened(stored, **changes)


def test_a_set_without_a_scene_is_refused(stored):
    with pytest.raises(BadInput, match="expected a scene to learn from, got none"):
        opened(replace(stored, entries=()))


def test_a_scene_of_one_frame_has_no_pairs(stored):
    """Nothing but "100 m everywhere" was learnt of it, and held out it ended in a traceback."""
    place, facts = stored.entries[3]
    single = facts | {key: facts[key][:1] for key in ("imgs", "depth")}
    entries = (*stored.entries[:3], (place, single), *stored.entries[4:])
    with pytest.raises(BadInput, match="expected 2 frames a scene, got 1"):
        opened(replace(stored, entries=entries))


@pytest.mark.parametrize(
    "odd",
    [{"speed": [0.0, 0.0, 2.0]}, {"position": [[0.0, 0.0, 0.0], [0.0, 0.0, 0.1], [0.0, 0.1, 0.2]]}],
    ids=["faster", "bent"],
)
def test_one_scene_whose_steps_differ_would_have_wrong_targets(stored, odd):
    place, facts = stored.entries[3]
    entries = (*stored.entries[:3], (place, facts | odd), *stored.entries[4:])
    with pytest.raises(BadInput, match=r"step: expected 0\.100 m everywhere, got 0\."):
        opened(replace(stored, entries=entries))


def test_what_was_clipped_is_as_far_as_can_be(tmp_path):
    """A sky stands at 200 m in the files; nine steps apart it was taken for a wall at 200 * 3 / 9 = 67 m."""
    source = small_source(open_share=1.0, frames=10)
    render_small(tmp_path / "open", source=source, scenes=2)
    stored = open_stored_set(tmp_path / "open")
    closed = source.scenes.config.model_copy(update={"open_share": 0.0})
    with opened(stored, config=closed) as stream:
        scene, cut, _ = stream._render(0)
    seen = stored.scene(stream._place(0)).depth_m
    assert 0 < (seen == 200).mean() < 1
    assert np.array_equal(np.isinf(cut.depth_m), seen == 200)
    target_m = PairRule().target_m(cut.depth_m[9], 9, 8.0)
    assert (target_m[seen[9] == 200] == 100).all()
    assert scene.frames == 10
