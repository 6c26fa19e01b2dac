"""What the authors' public PyTorch code asks of a Still Box folder, written anew from how that code behaves.

Training: every sub-folder of the root has a metadata.json; scenes of all sub-folders are shuffled, the first `split`
per cent train, the rest (less one) test. A sample is two pictures and the depth of the second, which is scaled in
place by shift / distance, or filled with 100 where both are one frame. Evaluation of poses: field of view and
resolution stand in `args`, a picture's name gives its scene's place in the metadata, quaternions are wxyz.
"""

from __future__ import annotations

import json
import math
import random
from pathlib import Path
from typing import Any

import cv2
import numpy as np


def split_scenes(
    root: Path, split: int = 80, shift: int = 3, seed: int = 0
) -> tuple[list[dict[str, Any]], list[Any]]:
    """(training scenes, test samples: two picture paths, a depth path, displacement)."""
    scenes = []
    for folder in sorted(path for path in root.iterdir() if path.is_dir()):
        for scene in json.loads((folder / "metadata.json").read_text())["scenes"]:
            scenes.append(scene | {"subdir": folder.name})
    random.Random(seed).shuffle(scenes)
    at = math.floor(len(scenes) * split / 100)
    tests = []
    for scene in scenes[at + 1 :]:
        moved = np.array(scene["speed"]).astype(np.float32) * shift * scene["time_step"]
        for i in range(len(scene["imgs"]) - shift):
            pictures = [f"{scene['subdir']}/{scene['imgs'][j]}" for j in (i, i + shift)]
            tests.append((pictures, f"{scene['subdir']}/{scene['depth'][i + shift]}", moved))
    return scenes[:at], tests


def training_sample(
    root: Path, scene: dict[str, Any], i1: int, i2: int, shift: int = 3
) -> tuple[list[np.ndarray], np.ndarray, np.ndarray]:
    """Pictures, target and displacement of frames i1 and i2."""
    folder = root / scene["subdir"]
    pictures = [cv2.imread(str(folder / scene["imgs"][i]))[:, :, ::-1] for i in (i1, i2)]
    target = np.load(folder / scene["depth"][i2])
    if i1 == i2:
        target.fill(100)
    else:
        target *= shift / abs(i2 - i1)
    moved = scene["time_step"] * np.array(scene["speed"]).astype(np.float32) * shift
    return pictures, np.clip(target, 0, 100), moved if i2 >= i1 else -moved


def relative_poses(scene: dict[str, Any], indices: list[int]) -> np.ndarray:
    """[N, 3, 4] poses in the axes of the last frame: position = index * speed * time_step."""
    quaternions = (
        np.array(scene["orientation"])[indices] if scene["orientation"] else [[1, 0, 0, 0]] * len(indices)
    )
    poses = []
    for index, (w, x, y, z) in zip(indices, quaternions, strict=True):
        pose = np.eye(4)
        pose[:3, :3] = [
            [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (w * y + x * z)],
            [2 * (w * z + x * y), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (w * x + y * z), w * w - x * x - y * y + z * z],
        ]
        pose[:3, 3] = index * np.array(scene["speed"]) * scene["time_step"]
        poses.append(pose)
    return (np.linalg.inv(poses[-1]) @ np.array(poses))[:, :3]


def intrinsics(metadata: dict[str, Any]) -> tuple[float, int, int]:
    """Focal length, width and height in pixels, as the evaluation finds them."""
    width, height = metadata["args"]["resolution"]
    return width / (2 * math.tan(math.pi * metadata["args"]["fov"] / 360)), width, height


def scene_of(sample: str, metadata: dict[str, Any]) -> dict[str, Any]:
    """The scene of a picture named RGB_SSSS_FF.jpg."""
    found: dict[str, Any] = metadata["scenes"][int(Path(sample).stem.split("_")[1])]
    return found
