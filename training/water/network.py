"""The network: from a picture to each pixel's logit of water, a small U-Net with residual blocks."""

from itertools import pairwise

import torch
from torch import nn
from torch.nn import functional

WIDTHS = (16, 32, 64, 96, 128)
"""Channels at a half, a quarter, ... a 32nd of the picture's size."""
BLOCKS = (0, 1, 2, 2, 2)


def convolution(inputs: int, outputs: int, stride: int = 1) -> nn.Sequential:
    """3 x 3, normalised, rectified."""
    layer = nn.Conv2d(inputs, outputs, 3, stride=stride, padding=1, bias=False)
    return nn.Sequential(layer, nn.BatchNorm2d(outputs), nn.ReLU())


class Residual(nn.Module):
    """Two convolutions added to what they are given."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.first = convolution(channels, channels)
        self.second = nn.Sequential(nn.Conv2d(channels, channels, 3, padding=1, bias=False), nn.BatchNorm2d(channels))

    def forward(self, values: torch.Tensor) -> torch.Tensor:
        """Values of the same shape."""
        return functional.relu(values + self.second(self.first(values)))


class WaterNet(nn.Module):
    """Logits ``(n, 1, h, w)`` of water from pictures ``(n, 3, h, w)``, RGB from 0 to 1, sides multiples of 32 px."""

    def __init__(self) -> None:
        super().__init__()
        inputs = (3, *WIDTHS[:-1])
        self.down = nn.ModuleList(
            nn.Sequential(convolution(before, after, stride=2), *(Residual(after) for _ in range(blocks)))
            for before, after, blocks in zip(inputs, WIDTHS, BLOCKS, strict=True)
        )
        self.whole_picture = nn.Sequential(nn.AdaptiveAvgPool2d(1), nn.Conv2d(WIDTHS[-1], WIDTHS[-1], 1), nn.ReLU())
        pairs = list(pairwise(WIDTHS))
        self.up = nn.ModuleList(
            nn.Sequential(convolution(here + below, here), *([Residual(here)] if level else []))
            for level, (here, below) in enumerate(pairs)
        )
        self.logit = nn.Conv2d(WIDTHS[0], 1, 3, padding=1)

    def forward(self, pictures: torch.Tensor) -> torch.Tensor:
        """See the class."""
        values = (pictures - 0.45) / 0.25
        levels = []
        for stage in self.down:
            values = stage(values)
            levels.append(values)
        values = values + self.whole_picture(values)
        for up, level in zip(reversed(self.up), reversed(levels[:-1]), strict=True):
            values = functional.interpolate(values, scale_factor=2.0, mode="bilinear", align_corners=False)
            values = up(torch.cat([values, level], dim=1))
        return functional.interpolate(self.logit(values), scale_factor=2.0, mode="bilinear", align_corners=False)
