"""The losses that training minimises."""

import torch
from torch.nn import functional

_REGRESSED_ABOVE = 0.5


def loss_of(answer: torch.Tensor, target: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Losses of confidence and of regression for answers (n, 6, h, w), each per true streak.

    ``target``: (n, 7, h, w) of ``targets_of``. Confidence: quality focal loss (Li et al. 2020)
    towards the heat, with beta 2, but 0 at streaks, so that clear streaks get a confidence well
    above that of lights that resemble them.
    """
    heat, weight = target[:, 0], target[:, 6]
    positives = (heat == 1.0).sum().clamp(min=1)
    logit = answer[:, 0]
    away = (torch.sigmoid(logit) - heat).abs()
    hardness = torch.where(heat == 1.0, torch.ones_like(away), away**2)
    cross = functional.binary_cross_entropy_with_logits(logit, heat, reduction="none")
    confidence = (weight * hardness * cross).sum() / positives
    share = torch.where(heat > _REGRESSED_ABOVE, heat, torch.zeros_like(heat))
    wrong = functional.smooth_l1_loss(answer[:, 1:], target[:, 1:6], reduction="none", beta=0.1)
    regression = (share[:, None] * wrong).sum() / share.sum().clamp(min=1)
    return confidence, regression
