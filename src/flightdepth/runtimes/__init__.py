"""An ONNX file in, a callable out; and any camera on the grid that the network knows."""

from flightdepth.runtimes.grid import NetworkGrid
from flightdepth.runtimes.network import Network, load_network, nearest_network, networks
from flightdepth.runtimes.prediction import Prediction

__all__ = ["Network", "NetworkGrid", "Prediction", "load_network", "nearest_network", "networks"]
