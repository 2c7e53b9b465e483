"""Training of our network for image reconstruction, a smaller E2VID."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from tasks.learned.e2vid_network import E2vidOptions, E2VIDRecurrent, State
from tasks.learned.ours import RECONSTRUCTION
from tasks.learned.training.problem import Arrays, Problem
from tasks.learned.training.settings import ReconstructionTraining
from tasks.methods.baselines import BlankVideo
from tasks.methods.e2vid import DARKEST
from tasks.methods.high_pass_filter import HighPassFilter
from tasks.methods.our_reconstruction import DECAYS, InputGrids
from tasks.psnr import psnr_db
from tasks.random_crops.crop import Crop
from tasks.random_crops.settings import Crops
from tasks.video import VideoMethod, picture

# Memory per pixel, window through which gradients flow, and channel at full resolution.
_BYTES_PER_PX_AND_CHANNEL = 200  # 125 were measured in bfloat16
_GAIN = 2.0  # gain of the sums of events in the initial output, before the sigmoid
_KEEP = 2.0  # initial bias of the keep gates: the memory lasts 8 windows; with 0 it would last 2
_ERROR_FLOOR = 1e-3  # of mean squared errors, 30 dB: better images are as good
_FLAT = 1e-4  # variance of a tile, of ranks from 0 to 1, below which it has little contrast
_EQUALIZATION = "global"  # an area of 160 px is a tile of the local equalization at 1280 px
_OTHERS = 0.1  # factor on the other channels' initial weights in the output layer


class Reconstruction(Problem):
    """Images from windows of events, histogram-equalized as for the score.

    The loss of an image is the logarithm of its mean squared error against the equalized true
    picture, as the metric compares ranks in dB; with the error itself, images that nothing can
    reconstruct would decide what is learned. Ranks are taken in an area as large as a tile of the
    score on wide sensors. Tiles on narrow sensors are smaller, so the loss is added for tiles of
    the image, each brought to the mean and contrast of ranks.
    """

    architecture = RECONSTRUCTION
    score = "PSNR [dB]"
    baselines = ("high-pass filter", "gray")

    settings: ReconstructionTraining

    def new_network(self) -> E2VIDRecurrent:
        """As `Problem.new_network`."""
        settings = self.settings
        options = E2vidOptions(
            num_bins=settings.bins + len(DECAYS),
            num_encoders=settings.encoders,
            base_num_channels=settings.base_channels,
            num_residual_blocks=settings.residual_blocks,
            use_upsample_conv=False,
        )
        network = E2VIDRecurrent(options)
        _start_as_the_filter(network)
        return network

    def held_out(self) -> tuple[Crops, int]:
        """As `Problem.held_out`: as large as the area of the ranks, a tile at 1280 px."""
        crops = replace(self.settings.crops, side_px=self.settings.ranked_px)
        return crops, self.settings.run_in_windows // 2

    def run_in(self, step: int) -> int:
        """As `Problem.run_in`."""
        drawn = np.random.SeedSequence([self.seed], spawn_key=(step, 0))
        return int(np.random.default_rng(drawn).integers(self.settings.run_in_windows + 1))

    def sample(self, crop: Crop, run_in: int) -> Arrays:
        """As `Problem.sample`; events of the windows before still enter the sums.

        Inputs are (windows, bins + 4, S, S), true images at the ends of the windows (windows, S, S)
        in [0, 1]: a pixel's brightness is its rank in an area around the crop.
        """
        side_px, ranked_px = crop.events[0].width, self.settings.ranked_px
        inputs = InputGrids(side_px, side_px, crop.contrast_threshold, self.settings.bins)
        grids = [inputs.push(events) for events in crop.events]
        first = (ranked_px - side_px) // 2
        inside = slice(first, first + side_px)
        logs = (crop.log_image(k, ranked_px) for k in range(run_in + 1, len(grids) + 1))
        pictures = [picture(log, log.shape, _EQUALIZATION)[inside, inside] for log in logs]
        return np.stack(grids[run_in:]), np.stack(pictures).astype(np.float32)

    def losses(self, batch: Sequence[Tensor]) -> Iterator[Tensor]:
        """As `Problem.losses`: the network's memory continues, gradients stop at each loss."""
        grids, pictures = batch
        states: list[State] | None = None
        for start in range(0, grids.shape[1], self.settings.windows_at_once):
            errors = []
            for k in range(start, start + self.settings.windows_at_once):
                image, states = self.network(grids[:, k], states)
                pair = image[:, 0].float(), pictures[:, k]
                in_tiles = [tiles_as_ranks(images, self.settings.tiles) for images in pair]
                errors.append(_log_error(*pair) + _log_error(*in_tiles))
            yield torch.stack(errors).mean()
            states = [tuple(part.detach() for part in state) for state in states or ()]

    def network_score(self, batch: Sequence[Tensor]) -> float:
        """As `Problem.network_score`: the PSNR of the later half of the windows."""
        grids, pictures = batch
        states, scores = None, []
        for k in range(grids.shape[1]):
            images, states = self.network(grids[:, k], states)
            if k >= grids.shape[1] // 2:
                logs = torch.log(images[:, 0].double().clamp(min=DARKEST)).cpu().numpy()
                truths = pictures[:, k].double().cpu().numpy()
                scores += [_psnr_db(*pair) for pair in zip(logs, truths, strict=True)]
        return float(np.mean(scores))

    def baseline_scores(self, crop: Crop, sample: Arrays) -> list[float]:
        """As `Problem.baseline_scores`."""
        _, pictures = sample
        size = crop.events[0].width, crop.events[0].height, crop.contrast_threshold
        methods: list[VideoMethod] = [HighPassFilter(*size), BlankVideo(*size)]
        windows = list(zip(crop.events, crop.ends_us, strict=True))
        means = []
        for method in methods:
            scores = []
            for k, (events, end_us) in enumerate(windows, start=len(pictures) - len(windows)):
                method.push(events)
                if k >= len(pictures) // 2:
                    truth = pictures[k].astype(np.float64)
                    scores.append(_psnr_db(method.image(end_us), truth))
            means.append(float(np.mean(scores)))
        return means

    def step_bytes(self) -> int:
        """As `Problem.step_bytes`."""
        settings = self.settings
        pixels = settings.schedule.crops_per_step * settings.crops.side_px**2
        per_px = _BYTES_PER_PX_AND_CHANNEL * settings.base_channels
        return per_px * pixels * settings.windows_at_once

    @property
    def values_per_px(self) -> int:
        """As `Problem.values_per_px`."""
        return self.settings.windows * (self.settings.bins + len(DECAYS) + 1)


def tiles_as_ranks(images: Tensor, tiles: int) -> Tensor:
    """Bring each tile to the mean and the standard deviation of ranks, 1/2 and 1/sqrt(12).

    (B, S, S) in, (B * tiles^2, S / tiles, S / tiles) out, row by row. A flat tile is gray.
    """
    side = images.shape[1] // tiles
    parts = images.unfold(1, side, side).unfold(2, side, side).reshape(-1, side, side)
    centered = parts - parts.mean(dim=(1, 2), keepdim=True)
    variance = torch.square(centered).mean(dim=(1, 2), keepdim=True)
    return 0.5 + centered / torch.sqrt(12 * (variance + _FLAT))


def _log_error(images: Tensor, truths: Tensor) -> Tensor:
    return torch.log(torch.square(images - truths).mean(dim=(1, 2)) + _ERROR_FLOOR).mean()


def _start_as_the_filter(network: E2VIDRecurrent) -> None:
    """Initialize the network so that it passes on the last input channel, a sum of events.

    It then starts with the scores of the high-pass filter, and need not learn to copy its input.
    The first two channels of the head take the positive and the negative part of the sums.
    """
    unet = network.unetrecurrent
    middle = unet.head.conv2d.kernel_size[0] // 2
    with torch.no_grad():
        for encoder in unet.encoders:
            encoder.recurrent_block.Gates.bias.chunk(4)[1].fill_(_KEEP)  # the keep gates
        unet.head.conv2d.weight[:2] = 0.0
        unet.head.conv2d.bias[:2] = 0.0
        unet.head.conv2d.weight[:2, -1, middle, middle] = torch.tensor([1.0, -1.0])
        unet.pred.conv2d.weight *= _OTHERS
        unet.pred.conv2d.weight[0, :2, 0, 0] = torch.tensor([_GAIN, -_GAIN])


def _psnr_db(log_image: np.ndarray, truth: np.ndarray) -> float:
    return psnr_db(picture(log_image, truth.shape, _EQUALIZATION), truth)
