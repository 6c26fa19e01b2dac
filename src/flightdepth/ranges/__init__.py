"""Depth at several ranges: displacement, frame pairs, fusion, clusters, and the estimator that joins them."""

from flightdepth.ranges.estimator import MultiRangeEstimator
from flightdepth.ranges.network import DepthNetwork
from flightdepth.ranges.result import RangedDepth

__all__ = ["DepthNetwork", "MultiRangeEstimator", "RangedDepth"]
