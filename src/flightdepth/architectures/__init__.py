"""The networks: nothing but layers."""

from flightdepth.architectures.depthnet import Activation, DepthNet

__all__ = ["Activation", "DepthNet"]
