"""The Still Box dataset: a stream of training pairs, augmentation and fixed test sets."""

from flightdepth.stillbox.pairs import Batch, PairRule
from flightdepth.stillbox.stored_testset import StoredTestSet
from flightdepth.stillbox.stream import PairStream, Picture
from flightdepth.stillbox.testset import OutdoorTestSet, TestPair, TestSet

__all__ = [
    "Batch",
    "OutdoorTestSet",
    "PairRule",
    "PairStream",
    "Picture",
    "StoredTestSet",
    "TestPair",
    "TestSet",
]
