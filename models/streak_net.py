"""MobileNetV2 (width 0.35) with a feature pyramid and a single-shot head of stride 4.

Sandler et al. 2018 for the blocks, Liu et al. 2016 for the head, Lin et al. 2017 for the pyramid.
Bilinear upsampling keeps the exported graph in one partition of TensorFlow Lite's XNNPACK.
"""

import torch
from torch import nn
from torch.nn import functional

ANSWERS = 6
_PYRAMID_CHANNELS = 48
_STAGES = (
    # expansion, channels, blocks, stride of the first
    (1, 8, 1, 1),
    (6, 8, 2, 2),
    (6, 16, 3, 2),
    (6, 24, 3, 2),
    (6, 32, 2, 1),
    (6, 56, 3, 2),
    (6, 112, 1, 1),
)
_TAPPED = (1, 2, 4, 6)
"""Stages whose output, at stride 4, 8, 16 and 32, feeds the pyramid."""
_RARE = -4.6
"""Logit of a prior of 1 %: most locations hold no streak."""


def _convolution(
    inside: int,
    outside: int,
    kernel: int = 3,
    stride: int = 1,
    groups: int = 1,
    *,
    is_linear: bool = False,
) -> nn.Sequential:
    layers: list[nn.Module] = [
        nn.Conv2d(inside, outside, kernel, stride, kernel // 2, groups=groups, bias=False),
        nn.BatchNorm2d(outside, momentum=0.03),
    ]
    if not is_linear:
        layers.append(nn.ReLU6())
    return nn.Sequential(*layers)


class InvertedResidual(nn.Module):
    """MobileNetV2's block: expand, filter each channel, project.

    With a shortcut where the shape stays the same.
    """

    def __init__(self, inside: int, outside: int, stride: int, expansion: int) -> None:
        super().__init__()
        wide = inside * expansion
        layers = [] if expansion == 1 else [_convolution(inside, wide, 1)]
        layers += [
            _convolution(wide, wide, 3, stride, groups=wide),
            _convolution(wide, outside, 1, is_linear=True),
        ]
        self.layers = nn.Sequential(*layers)
        self.is_residual = stride == 1 and inside == outside

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Transform (n, inside, h, w) to (n, outside, h / stride, w / stride)."""
        y: torch.Tensor = self.layers(x)
        return x + y if self.is_residual else y


class StreakNet(nn.Module):
    """The network: from maps (n, 1, h, w) in 0..1 to answers (n, 6, h / 4, w / 4).

    h and w are multiples of 32. The channels of the answers are described in ``models.targets``.
    """

    def __init__(self) -> None:
        super().__init__()
        self.stem = _convolution(1, 16, 3, 2)
        stages, channels = [], 16
        for expansion, outside, blocks, stride in _STAGES:
            layers = []
            for block in range(blocks):
                layers.append(
                    InvertedResidual(channels, outside, stride if block == 0 else 1, expansion)
                )
                channels = outside
            stages.append(nn.Sequential(*layers))
        self.stages = nn.ModuleList(stages)
        self.laterals = nn.ModuleList(
            [_convolution(_STAGES[i][1], _PYRAMID_CHANNELS, 1, is_linear=True) for i in _TAPPED]
        )
        width = _PYRAMID_CHANNELS
        self.smooth = nn.ModuleList(
            [
                nn.Sequential(
                    _convolution(width, width, 5, groups=width), _convolution(width, width, 1)
                )
                for _ in range(3)
            ]
        )
        self.head = nn.Sequential(
            _convolution(width, width, 3, groups=width),
            _convolution(width, 64, 1),
            _convolution(64, 64, 5, groups=64),
            _convolution(64, 64, 1),
            nn.Conv2d(64, ANSWERS, 1),
        )
        nn.init.constant_(self.head[-1].bias, 0.0)
        with torch.no_grad():
            self.head[-1].bias[0] = _RARE

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Compute the answers (n, 6, h / 4, w / 4) for maps (n, 1, h, w)."""
        x = self.stem(x)
        tapped = []
        for index, stage in enumerate(self.stages):
            x = stage(x)
            if index in _TAPPED:
                tapped.append(x)
        merged = self.laterals[-1](tapped[-1])
        for level in (2, 1, 0):
            merged = functional.interpolate(
                merged, scale_factor=2.0, mode="bilinear", align_corners=False
            )
            merged = self.smooth[level](merged + self.laterals[level](tapped[level]))
        answers: torch.Tensor = self.head(merged)
        return answers
