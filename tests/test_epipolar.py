"""Distances from epipolar lines, and what small errors of a motion add to them: against the book and small steps."""

import cv2
import numpy as np
import pytest

from flightdepth.epipolar import LEAST_REACH, aside, lines

WAYS = [(1, 0, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1), (0.5, 0.3, 0.8)]
COUNT = 150


def rays_of(way):
    """Rays now and before a move of 0.3 m, seen by a camera that turned a little and errs."""
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-1, 1, (COUNT, 2)), np.ones(COUNT)])
    points *= np.exp(rng.uniform(np.log(2), np.log(60), (COUNT, 1)))
    moved = points + 0.3 * np.array(way) / np.linalg.norm(way)
    moved = moved @ cv2.Rodrigues(np.radians([0.3, -0.4, 0.2]))[0]
    now, before = points / points[:, 2:], moved / moved[:, 2:]
    before[:, :2] += rng.normal(0, 0.002, (COUNT, 2))
    return now, before


def turned_towards(unit, towards, angle):
    turned = unit + angle * towards
    return turned / np.linalg.norm(turned)


@pytest.mark.parametrize("way", WAYS)
def test_two_axes_stand_across_a_direction(way):
    unit = np.array(way) / np.linalg.norm(way)
    axes = np.column_stack([unit, aside(unit)])
    assert axes.T @ axes == pytest.approx(np.eye(3), abs=1e-12)


def distances(now, before, unit):
    """By the book: from the epipolar lines d x now, and along them, away from where d points."""
    normals = np.cross(unit, now)
    reach = np.maximum(np.hypot(normals[:, 0], normals[:, 1]), LEAST_REACH)
    along = np.column_stack([normals[:, 1], -normals[:, 0]])
    off = (normals * before).sum(axis=1)
    return np.concatenate([off, -((before - now)[:, :2] * along).sum(axis=1)]) / np.tile(reach, 2)


@pytest.mark.parametrize("way", WAYS)
def test_rows_are_the_derivatives_of_distances_from_lines(way):
    now, before = rays_of(way)
    unit = np.array(way) / np.linalg.norm(way)
    around, step = aside(unit), 1e-6
    rows = lines(now.T, before.T, unit, around)
    plain = distances(now, before, unit)
    np.testing.assert_allclose(rows[5], plain, atol=1e-12)
    for axis in range(3):
        moved = before @ cv2.Rodrigues(step * np.eye(3)[axis])[0].T
        slope = (distances(now, moved / moved[:, 2:], unit) - plain) / step
        # Bringing a ray back to z = 1 shortens it by the turn: a second order of small things.
        np.testing.assert_allclose(rows[axis, COUNT:], slope[COUNT:], atol=1e-4)
        np.testing.assert_allclose(rows[axis, :COUNT], slope[:COUNT], atol=3 * np.abs(plain[:COUNT]).max())
    far = np.hypot(*(unit[:2, None] - now[:, :2].T * unit[2])) > LEAST_REACH
    for k in range(2):
        slope = (distances(now, before, turned_towards(unit, around @ np.eye(2)[k], step)) - plain) / step
        close = np.abs(rows[3 + k, :COUNT] - slope[:COUNT])[far]
        assert np.median(close) < 0.01 and not rows[3 + k, COUNT:].any()
