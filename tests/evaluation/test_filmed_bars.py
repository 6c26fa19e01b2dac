"""The benchmark of error bars in filmed pictures, without its pictures."""

import importlib
import sys
from pathlib import Path
from types import SimpleNamespace

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))
filmed_bars = importlib.import_module("filmed_bars")


def test_few_scenes_may_all_be_rooms(monkeypatch):
    """`--scenes 1` ended in a ValueError."""
    figures = [0.1, 0.2, 0.3, 0.4]
    monkeypatch.setattr(filmed_bars, "load_network", lambda *_, **__: SimpleNamespace())
    monkeypatch.setattr(filmed_bars, "origin_of", lambda _: "")
    monkeypatch.setattr(filmed_bars, "rows", lambda *_: ((way, True, figures) for way in filmed_bars.WAYS))
    table = filmed_bars.measure("motion", 1)
    kinds, errors = (list(table.columns[number].cells) for number in (1, 2))
    assert kinds == ["rooms"] * len(filmed_bars.WAYS)
    assert set(errors) == {"0.100"}
