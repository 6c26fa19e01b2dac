"""What a run writes down beside its checkpoints: back whole, or refused in one line, not by a traceback."""

from pathlib import Path

import pytest
from training_runs import small_recipe, small_textures

from flightdepth.errors import BadInput
from flightdepth.files import write_json
from flightdepth.stillbox.stored import StoredSet
from flightdepth.training.run_folder import (
    PARENT,
    RECIPE,
    SETS,
    SHIPPED,
    TEXTURES,
    Parent,
    UsedSet,
    _parent,
    _shipped,
    _used_sets,
    keep_origin,
    keep_sets,
    keep_textures,
    read_recipe,
    stored_renderers,
)
from flightdepth.weights.store import find_network, read_card

STORED = StoredSet(Path("stillbox"), 64, 64, 90.0, "raycast-2", ())
READERS = {
    RECIPE: lambda folder: read_recipe(folder / RECIPE),
    TEXTURES: lambda folder: keep_textures(folder, small_textures()),
    SETS: lambda folder: keep_sets(folder, {64: STORED}),
    SHIPPED: lambda folder: _shipped(folder / SHIPPED),
    PARENT: lambda folder: _parent(folder / "checkpoint.safetensors", small_recipe(starts_from="one")),
}


@pytest.fixture
def folder(tmp_path):
    write_json(tmp_path / RECIPE, small_recipe().model_dump(mode="json"))
    card = read_card(find_network("depthnet-256"))
    keep_origin(tmp_path, shipped=card, parent=Parent(card.stages, card))
    keep_sets(tmp_path, {64: STORED})
    keep_textures(tmp_path, small_textures())
    return tmp_path


def test_all_of_it_comes_back(folder):
    assert READERS[RECIPE](folder) == small_recipe()
    assert READERS[SHIPPED](folder) == read_card(find_network("depthnet-256"))
    card = READERS[SHIPPED](folder)
    assert READERS[PARENT](folder) == Parent(card.stages, card)
    assert _used_sets(folder) == {"64": UsedSet(0, STORED.digest, "raycast-2")}
    assert stored_renderers(folder) == "stored: raycast-2"
    keep_sets(folder, {64: STORED})
    keep_textures(folder, small_textures())


@pytest.mark.parametrize("data", [b"", b"[]", b'{"64": 1}', None], ids=["empty", "a list", "other", "cut"])
@pytest.mark.parametrize("name", READERS)
def test_what_no_run_wrote_is_named(folder, name, data):
    path = folder / name
    path.write_bytes(path.read_bytes()[:-9] if data is None else data)
    with pytest.raises(BadInput, match=rf"{name}.*: expected what train wrote there, got ") as caught:
        READERS[name](folder)
    assert "\n" not in str(caught.value)


def test_a_fresh_run_forgets_what_another_began_from(folder):
    keep_origin(folder)
    assert READERS[SHIPPED](folder) is None
    assert READERS[PARENT](folder) is None


def test_a_run_of_drawn_scenes_names_no_stored_renderer(tmp_path):
    assert stored_renderers(tmp_path) is None
