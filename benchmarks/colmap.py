"""How well a log's poses fit the pictures: of what `flightdepth convert out flight.colmap` wrote, this tells

    pip install pycolmap
    python benchmarks/colmap.py flight.colmap

COLMAP follows SIFT features from picture to picture and triangulates them. Where poses are right, each point falls back
where it was seen: printed is by how many pixels it misses, with the poses as they are, and after COLMAP moved them and
the points so that they fit (bundle adjustment); and how far pictures turned against those before. Besides: how far the
project's depth is from that of the points at the pixels where they were seen.
"""

from __future__ import annotations

import argparse
import tempfile
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pycolmap
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from flightdepth.outputs.colmap import DEPTH_UNIT_M, DEPTHS, IMAGES, SPARSE

Values = NDArray[np.float64]


def triangulated(project: Path, work: Path) -> pycolmap.Reconstruction:
    """Points of features, by the poses of the project; a point that misses by more than 4 px is none."""
    model = pycolmap.Reconstruction(project / SPARSE / "0")
    (camera,) = model.cameras.values()  # a lens that zoomed has several
    features, matches = pycolmap.FeatureExtractionOptions(), pycolmap.FeatureMatchingOptions()
    features.use_gpu = matches.use_gpu = False
    features.num_threads = 1  # pictures are numbered as they come: by name, as the project's are
    lens = pycolmap.ImageReaderOptions()
    lens.camera_model, lens.camera_params = camera.model.name, ",".join(map(str, camera.params))
    database, pictures = work / "database.db", project / IMAGES
    single = pycolmap.CameraMode.SINGLE
    pycolmap.extract_features(
        database, pictures, camera_mode=single, reader_options=lens, extraction_options=features
    )
    pycolmap.match_sequential(database, matching_options=matches)
    return pycolmap.triangulate_points(
        model, database, pictures, work, clear_points=True, refine_intrinsics=False
    )


def adjust(model: pycolmap.Reconstruction) -> None:
    """Move poses and points until they fit; the lens stays."""
    options = pycolmap.BundleAdjustmentOptions()
    options.refine_focal_length = options.refine_principal_point = options.refine_extra_params = False
    pycolmap.bundle_adjustment(model, options)


def misses_px(model: pycolmap.Reconstruction) -> Values:
    """Of each time that a point was seen, how far from there it falls."""
    found = []
    for image in model.images.values():
        for seen in image.get_observation_points2D():
            there = image.project_point(model.points3D[seen.point3D_id].xyz)
            if there is not None:
                found.append(np.linalg.norm(there - seen.xy))
    return np.array(found)


def steps(model: pycolmap.Reconstruction) -> list[Values]:
    """Rotation (3, 3) of each picture from that before."""
    turns = [image.cam_from_world().rotation.matrix() for _, image in sorted(model.images.items())]
    return [later @ earlier.T for earlier, later in pairwise(turns)]


def depth_ratios(model: pycolmap.Reconstruction, project: Path) -> Values:
    """The project's depth over that of a point, each time that it was seen where depth is known."""
    found = []
    for image in model.images.values():
        depth_m = (
            cv2.imread(str(project / DEPTHS / f"{image.name[:-4]}.png"), cv2.IMREAD_UNCHANGED) * DEPTH_UNIT_M
        )
        pose = image.cam_from_world()
        for seen in image.get_observation_points2D():
            column, row = np.floor(seen.xy).astype(int)
            there_m = (pose * model.points3D[seen.point3D_id].xyz)[2]
            found.append(depth_m[row, column] / there_m)
    ratios = np.array(found)
    return ratios[ratios > 0]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("project", type=Path, help="the folder that ends in .colmap")
    project = parser.parse_args().project
    pycolmap.logging.minloglevel = pycolmap.logging.WARNING.value
    heads = "poses, points, seen, pixels off: mean, median, 95 % within, turned from the picture before: median, 95 %"
    table = Table(*heads.split(", "), title=str(project))
    with tempfile.TemporaryDirectory() as work:
        model = triangulated(project, Path(work))
    ratios, before = depth_ratios(model, project), steps(model)
    for poses in ("the log's", "adjusted"):
        off_px = misses_px(model)
        cells = [f"{len(model.points3D):,}", f"{len(off_px):,}"]
        cells += [f"{value:.2f}" for value in (off_px.mean(), *np.percentile(off_px, (50, 95)))]
        apart = [np.linalg.norm(cv2.Rodrigues(a @ b.T)[0]) for a, b in zip(steps(model), before, strict=True)]
        cells += [f"{value:.3f} deg" for value in np.degrees(np.percentile(apart, (50, 95)))]
        table.add_row(poses, *cells)
        if poses == "the log's":
            adjust(model)
    Console().print(table)
    within = ", ".join(
        f"{np.mean(np.abs(ratios - 1) <= share):.0%} within {share:.0%}" for share in (0.05, 0.1, 0.2)
    )
    Console().print(f"depth over that of {len(ratios):,} features: median {np.median(ratios):.3f}; {within}")


if __name__ == "__main__":
    main()
