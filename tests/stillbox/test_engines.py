"""Scenes by threads and by a Ray cluster: the same bytes, in order."""

import threading
from dataclasses import replace

import cluster_tasks
import pytest
from small_sets import TEXTURES, small_source

from flightdepth.errors import BadInput, FlightDepthError
from flightdepth.renderers import raycast
from flightdepth.stillbox import engines
from flightdepth.stillbox.encoding import Renderer
from flightdepth.stillbox.engines import on_ray, on_threads

SOURCE = small_source()
SCENE_BYTES = 16 * 12 * (3 * 7 + 28)  # three frames
NUMBERS = range(3, 20)


def one_by_one(numbers=NUMBERS):
    return [SOURCE.encoded(number, TEXTURES) for number in numbers]


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_threads_give_scenes_in_order(threads):
    assert list(on_threads(SOURCE, TEXTURES, NUMBERS, threads)) == one_by_one()


def test_nothing_to_do():
    assert list(on_threads(SOURCE, TEXTURES, range(5, 5))) == []


@pytest.mark.parametrize(("scenes", "threads"), [(0.5, 1), (5, 2), (100, 8)])
def test_no_more_scenes_are_in_memory_than_have_room(monkeypatch, scenes, threads):
    """Room for one was asked for, whatever the number of cores, each of which has one in work and one that waits."""
    begun = []
    monkeypatch.setattr(engines, "usable_cores", lambda: 8)
    monkeypatch.setattr(raycast, "memory_bytes", lambda: scenes * SCENE_BYTES / raycast.MEMORY_SHARE)
    monkeypatch.setattr(engines, "ThreadPoolExecutor", lambda count, **_: begun.append(count) or 1 / 0)
    with pytest.raises(ZeroDivisionError):
        list(on_threads(SOURCE, TEXTURES, NUMBERS))
    assert begun == [threads]


def with_renderer(render):
    return replace(SOURCE, renderer=Renderer("broken", render))


def test_an_error_in_a_thread_surfaces():
    with pytest.raises(ZeroDivisionError):
        list(on_threads(with_renderer(cluster_tasks.fails), TEXTURES, NUMBERS))


def test_threads_end_with_who_takes_their_scenes():
    scenes = on_threads(SOURCE, TEXTURES, range(1000), 2)
    next(scenes)
    scenes.close()
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("render")]


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    """Two workers on this machine."""
    ray = pytest.importorskip("ray", reason="needs flightdepth[cluster]")
    died = tmp_path_factory.mktemp("cluster") / "died"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("RAY_USAGE_STATS_ENABLED", "0")
        patch.setenv(cluster_tasks.DIED, str(died))
        ray.init(num_cpus=2, include_dashboard=False, logging_level="ERROR", log_to_driver=False)
        ray.cloudpickle.register_pickle_by_value(cluster_tasks)  # workers have no such module
        yield died
        ray.cloudpickle.unregister_pickle_by_value(cluster_tasks)
        ray.shutdown()


def test_a_cluster_gives_the_same_bytes(cluster):
    assert list(on_ray(SOURCE, TEXTURES, NUMBERS)) == one_by_one()


def test_a_killed_workers_task_is_run_again(cluster):
    numbers = range(6)
    assert list(on_ray(with_renderer(cluster_tasks.dies_once), TEXTURES, numbers)) == one_by_one(numbers)
    assert cluster.exists()


def test_a_bug_in_a_task_is_one_line(cluster):
    with pytest.raises(FlightDepthError) as error:
        list(on_ray(with_renderer(cluster_tasks.fails), TEXTURES, NUMBERS))
    assert str(error.value) == "rendering scenes 3-6 on Ray: ZeroDivisionError: no light"


def test_bad_input_of_a_task_is_bad_input(cluster):
    with pytest.raises(BadInput, match=r"^blender: expected version 4\.5, got 2\.79$"):
        list(on_ray(with_renderer(cluster_tasks.refuses), TEXTURES, NUMBERS))
