"""What stays in float32 where OpenVINO computes all else in bf16.

Differences of two pictures do: bf16 rounds grey values to half a level of 255, more than a pixel of depth changes them
where things are far. OpenVINO knows a mark for it, which from Python only its own file format can set.
"""

from __future__ import annotations

import logging
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from xml.etree import ElementTree

import openvino as ov

from flightdepth.processor import openvino_core

logger = logging.getLogger(__name__)

DIFFERENCES = "Abs"  # what they are all taken for
MARK = {"name": "precise", "version": "0"}


def precise_differences(model: Any) -> Any:
    """A copy of the graph in which absolute values, and the sums that lead to them, are computed in float32.

    The graph itself where it has none, or where no temporary file can be written.
    """
    if not any(node.get_type_name() == DIFFERENCES for node in model.get_ops()):
        return model
    try:
        with TemporaryDirectory() as folder:
            path = Path(folder) / "graph.xml"
            ov.save_model(model, path, compress_to_fp16=False)
            graph, weights = ElementTree.parse(path).getroot(), path.with_suffix(".bin").read_bytes()
    except (OSError, RuntimeError, ElementTree.ParseError) as error:  # OpenVINO's own is a RuntimeError
        logger.warning("bf16 costs a few percent of the error here, for want of temporary files: %s", error)
        return model
    for layer in graph.iterfind(f"layers/layer[@type='{DIFFERENCES}']"):
        facts = layer.find("rt_info")
        if facts is None:
            facts = ElementTree.Element("rt_info")
            layer.insert(1 if layer.find("data") is not None else 0, facts)
        ElementTree.SubElement(facts, "attribute", MARK)
    return openvino_core().read_model(ElementTree.tostring(graph), weights)
