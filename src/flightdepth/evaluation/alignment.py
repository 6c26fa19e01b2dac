"""Fitting the judge of `runtimes.alignment`, on scenes that neither training nor a test uses.

Rooms and flights outdoors, lenses of 25 to 110 degrees, displacements of one to nine frames; three in five with what a
camera does to pictures, and three in five with a motion that is reported wrongly and then mended as in flight.
`benchmarks/alignment.py --fit` runs it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from flightdepth.camera import Camera
from flightdepth.ranges.derotation import derotated
from flightdepth.renderers.raycast import render
from flightdepth.runtimes.alignment import Judge, clues_of
from flightdepth.runtimes.network import Network
from flightdepth.scenes import StillBoxConfig, Textures, chance, draw_scene
from flightdepth.scenes.outdoor_config import OutdoorConfig
from flightdepth.scenes.outdoor_textures import outdoor_textures
from flightdepth.stillbox.motion_noise import rotated, tilted
from flightdepth.stillbox.pairs import Pair
from flightdepth.stillbox.photometric import Photometric
from flightdepth.stillbox.sets import SceneSet
from flightdepth.sweep import unit_direction

Image = NDArray[np.uint8]
Maps = NDArray[np.float32]

SEED = 2018_0_2026
SHAPES = (
    (256, 256),
    (256, 192),
    (192, 256),
)  # so that the grid is the camera; less for a network that sees less
FOV_DEG = (25.0, 110.0)
ROOM_SHIFTS, OUTDOOR_SHIFTS = (1, 2, 3, 3, 4, 6, 9), (1, 1, 2, 3, 5, 8)  # frames
ROOM_SHARE, EFFECTS_SHARE, WRONG_SHARE = 0.55, 0.6, 0.6
WRONG_ROTATION_DEG, WRONG_DIRECTION_DEG = 0.5, 4.0  # the largest; small ones are more frequent (u^2)
TEXTURE_SETS = 3
HIDDEN = (16, 16)
STEPS, BATCH, RATE = 3000, 16384, 6e-3
METRE_WEIGHT = 0.03  # of an error in metres at D0 beside a relative one
LARGEST_ERROR = 3.0  # relative; more counts as this
INSIDE_ONE = 0.68


def fitting_pairs(count: int, shrunk: int = 1, seed: int = SEED) -> Iterator[Pair]:
    """Pairs of pictures 1 / `shrunk` as large as SHAPES."""
    effects = Photometric()
    for number in range(count):
        rng = np.random.default_rng([seed, number])
        width, height = SHAPES[rng.integers(len(SHAPES))]
        camera = Camera.from_fov(width // shrunk, height // shrunk, float(rng.uniform(*FOV_DEG)))
        if rng.random() < ROOM_SHARE:
            textures = _room_textures(seed + int(rng.integers(TEXTURE_SETS)))
            scene = draw_scene(StillBoxConfig(), len(textures), seed, number)
            frames = (0, int(rng.choice(ROOM_SHIFTS)))
        else:
            textures = _outdoor_textures(seed + int(rng.integers(TEXTURE_SETS)))
            config = OutdoorConfig(frames=60, rate_hz=10.0, legs="any")
            scene = SceneSet(config, camera.width, camera.height, seed).scene(number, 0)
            first = int(rng.integers(0, config.frames - max(OUTDOOR_SHIFTS)))
            frames = (first, first + int(rng.choice(OUTDOOR_SHIFTS)))
        if rng.random() < 0.3:
            frames = frames[::-1]
        seen = render(scene, textures, camera, frames=frames)
        pair = Pair(seen.images[0], seen.images[1], seen.depth_m[1], scene.displacement(*frames), camera)
        if rng.random() < EFFECTS_SHARE:
            pair = effects(rng, pair)
        yield reported_wrongly(pair, rng) if rng.random() < WRONG_SHARE else pair


@cache
def _room_textures(seed: int) -> Textures:
    return Textures.procedural(64, seed)


@cache
def _outdoor_textures(seed: int) -> Textures:
    return outdoor_textures(seed)


def reported_wrongly(pair: Pair, rng: np.random.Generator) -> Pair:
    """The same with a motion that is off, mended as far as the pictures allow."""
    turn = chance.unit_vector(rng) * np.radians(WRONG_ROTATION_DEG) * rng.random() ** 2
    previous = rotated(pair.previous, pair.camera, turn)
    motion = tilted(pair.displacement, chance.unit_vector(rng), WRONG_DIRECTION_DEG * rng.random() ** 2)
    previous, motion, _ = derotated(previous, pair.current, motion, pair.camera)
    return replace(pair, previous=previous, displacement=motion)


def rows_of(network: Network, pair: Pair) -> Maps:
    """The clues of each pixel, then the truth over the network's depth and over its range, [N, k + 2]."""
    grid, length_m = network.grid(pair.camera), float(np.linalg.norm(pair.displacement))
    pictures = grid.image(pair.previous), grid.image(pair.current)
    found = network.predict([pair.previous], pair.current, pair.displacement[None], pair.camera)
    depth_m, sigma_m = found.depth_m[0], found.sigma_m
    if sigma_m is None:
        raise ValueError(f"expected a network that tells sigma_m, got {network.card.name}")
    previous, current = (np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.uint8) for image in pictures)
    sigma = sigma_m[0] / depth_m / np.float32(network.card.sigma_scale)
    direction = unit_direction(pair.displacement)
    clues, depth = clues_of(previous, current, depth_m / length_m, sigma, direction, camera=grid.camera)
    depth_m = depth * np.float32(length_m)
    range_m = network.card.at_focal(grid.camera.fx).alpha * length_m
    truth_m = cv2.resize(pair.target_m.clip(0, range_m), depth_m.shape[::-1], interpolation=cv2.INTER_AREA)
    rows = np.stack([*clues, truth_m / depth_m, truth_m / range_m])[:, found.valid & np.isfinite(truth_m)]
    return np.asarray(rows.T, np.float32)


def fitted_judge(rows: Maps, *, steps: int = STEPS, seed: int = 0) -> Judge:
    """The judge with the least relative error, with an error bar that 68 % of the errors are inside."""
    import torch
    from torch import nn
    from torch.nn import functional

    torch.manual_seed(seed)
    table = torch.from_numpy(rows)
    count = table.shape[1] - 2
    mean, deviation = table[:, :count].mean(0), table[:, :count].std(0).clamp_min(1e-6)
    sizes = (count, *HIDDEN, 2)
    linear = [nn.Linear(*pair) for pair in pairwise(sizes)]
    model = nn.Sequential(*(part for layer in linear for part in (layer, nn.ReLU())))[:-1]
    optimizer = torch.optim.AdamW(model.parameters(), RATE, weight_decay=1e-4)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, RATE, total_steps=steps)
    for _ in range(steps):
        batch = table[torch.randint(0, len(table), (BATCH,))]
        clues, truth, share = batch[:, :count], batch[:, count], batch[:, count + 1]
        answer = model((clues - mean) / deviation)
        depth = torch.exp(-torch.sigmoid(answer[:, 0]) * clues[:, 0])  # over the network's
        in_range = share < 0.99
        off = (depth - truth).abs()
        loss = (off / truth).clamp(max=LARGEST_ERROR)[in_range].mean()
        loss = loss + METRE_WEIGHT * 100 * (off / truth * share).mean()
        error = (off / depth).detach()[in_range]
        bar = (functional.softplus(answer[:, 1]) * torch.exp(clues[:, 1]))[in_range]
        pinball = torch.where(error > bar, INSIDE_ONE * (error - bar), (1 - INSIDE_ONE) * (bar - error))
        loss = loss + pinball.clamp(max=5).mean()
        optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        optimizer.step()
        schedule.step()
    layers = [(layer.weight.detach().T, layer.bias.detach()) for layer in linear]
    weights, offsets = layers[0]
    layers[0] = (weights / deviation[:, None], offsets - (mean / deviation) @ weights)  # of clues as they are
    return Judge(tuple((w.contiguous().numpy(), b.numpy()) for w, b in layers))
