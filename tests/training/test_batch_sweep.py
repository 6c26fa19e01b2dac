"""A batch swept by PyTorch, against OpenCV's sweep of each pair, on which networks fly."""

import numpy as np
import pytest
import torch

from flightdepth.camera import Camera
from flightdepth.scenes import chance
from flightdepth.stillbox.pairs import Batch, Pair
from flightdepth.sweep import stacked, sweep
from flightdepth.training.batch_sweep import motions, swept_batch

SIZE = 64


def smooth_picture(rng):
    """Random, and so soft that a thirty-second of a pixel is a few grey levels at most."""
    coarse = torch.from_numpy(rng.uniform(0, 255, (1, 3, SIZE // 4, SIZE // 4)))
    fine = torch.nn.functional.interpolate(coarse, size=(SIZE, SIZE), mode="bicubic")[0]
    return np.ascontiguousarray(fine.permute(1, 2, 0).clamp(0, 255).to(torch.uint8).numpy())


def pair(seed, displacement=None):
    rng = np.random.default_rng(seed)
    whole = Camera.from_fov(SIZE + 16, SIZE + 16, rng.uniform(35, 120))
    camera = whole.cropped(int(rng.integers(16)), int(rng.integers(16)), SIZE, SIZE)
    moved = chance.unit_vector(rng) if displacement is None else np.array(displacement)
    return Pair(smooth_picture(rng), smooth_picture(rng), np.zeros((SIZE, SIZE), np.float32), moved, camera)


PAIRS = {
    "any direction": [pair(seed) for seed in range(12)],
    "sideways": [pair(1, (1, 0, 0)), pair(2, (0, -0.3, 0))],
    "ahead and back": [pair(3, (0, 0, 0.3)), pair(4, (0, 0, -2))],
    "still": [pair(5, (0, 0, 0))],
}


@pytest.mark.parametrize("each", PAIRS.values(), ids=PAIRS)
def test_a_batch_is_swept_as_each_pair_is(each):
    batch = Batch(tuple(each))
    current, *levels, field = swept_batch(torch.from_numpy(batch.pairs), motions(batch))
    expected = stacked(sweep(p.previous, p.current, p.displacement, p.camera) for p in each)
    assert np.array_equal(current.numpy(), expected[0])
    for level, truth in zip(levels, expected[1:-1], strict=True):
        assert level.dtype == torch.uint8
        off = abs(level.numpy().astype(int) - truth.astype(int))
        assert off.mean() < 0.2
        # Steps of a thirty-second of a pixel may fall to either side; what lies outside must be the same pixels.
        assert (off > 4).mean() < 1e-3
    assert np.allclose(field.numpy(), expected[-1], atol=1e-5)
