"""The networks: nothing but layers."""

from flightdepth.architectures.depthnet import Activation, DepthNet
from flightdepth.architectures.flownets import FlowNetS
from flightdepth.architectures.motionnet import MotionNet

__all__ = ["Activation", "DepthNet", "FlowNetS", "MotionNet"]
