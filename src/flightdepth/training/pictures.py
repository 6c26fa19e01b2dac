"""From the bytes of a batch to what the network sees."""

from __future__ import annotations

import torch
from torch import Tensor


def normalised(pairs: Tensor) -> Tensor:
    """uint8 [B, H, W, 6] to float [B, 6, H, W], (x / 255 - 0.5) / 0.2, channels last in memory."""
    images = pairs.permute(0, 3, 1, 2).to(torch.float32)
    return (images * (1 / 255 / 0.2) - 0.5 / 0.2).contiguous(memory_format=torch.channels_last)
