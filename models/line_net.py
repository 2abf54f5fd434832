"""The verifier: MobileNetV2's blocks on the small image of one proposed line.

From images (n, 4, 24, 64) and figures (n, 10) of ``vision.lines.line_images`` to answers (n, 5):
the log-odds that the line is a streak, then the true ends' places along and across, from the
proposed ones, in columns and rows of the image.
"""

import torch
from torch import nn

from models.streak_net import InvertedResidual, _convolution
from rsoconsole.vision import LINE_FIGURES, LINE_IMAGE_SHAPE

ANSWERS = 5


class LineNet(nn.Module):
    """The network; ``forward`` takes images and figures."""

    def __init__(self) -> None:
        super().__init__()
        channels, rows, columns = LINE_IMAGE_SHAPE
        self.stem = nn.Sequential(
            nn.Conv2d(channels, 16, 5, 2, 2, bias=False),
            nn.BatchNorm2d(16, momentum=0.03),
            nn.ReLU6(),
        )
        self.blocks = nn.Sequential(
            InvertedResidual(16, 16, 1, 2),
            InvertedResidual(16, 24, 2, 4),
            InvertedResidual(24, 24, 1, 4),
            InvertedResidual(24, 24, 1, 4),
            InvertedResidual(24, 48, 2, 4),
            InvertedResidual(48, 48, 1, 4),
            _convolution(48, 32, 1),
        )
        flat = 32 * (rows // 8) * (columns // 8)
        self.figures = nn.Sequential(nn.Linear(LINE_FIGURES, 32), nn.ReLU())
        self.head = nn.Sequential(
            nn.Linear(flat + 32, 96),
            nn.ReLU6(),
            nn.Linear(96, 48),
            nn.ReLU6(),
            nn.Linear(48, ANSWERS),
        )

    def forward(self, images: torch.Tensor, figures: torch.Tensor) -> torch.Tensor:
        x = self.blocks(self.stem(images)).flatten(1)
        answer: torch.Tensor = self.head(torch.cat([x, self.figures(figures)], dim=1))
        return answer
