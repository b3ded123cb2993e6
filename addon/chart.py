# SPDX-License-Identifier: GPL-3.0-or-later
"""The picture of a study: error against time, both by powers of ten."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

from PIL import Image, ImageDraw, ImageFont

if TYPE_CHECKING:
    from fmm_core.study import Bake, Study

#: Pixels of the picture, and by how much larger it is drawn for smooth lines.
SIZE, SCALE = (1600, 1000), 2
#: Left, top, right and bottom of the plot.
_PLOT = (140, 120, 1230, 860)
#: Colour, name and the value that tells the points of a series apart (Okabe and Ito's colours, told apart by all eyes).
_SERIES: dict[str, tuple[str, str, Callable[[Bake], str]]] = {
    "rays": ("#0072B2", "more rays", lambda bake: f"{bake.rays}"),
    "p": ("#D55E00", "larger p", lambda bake: f"p {bake.truncation}"),
    "s": ("#009E73", "other s", lambda bake: f"s {bake.grouping}"),
    "paper": ("#CC79A7", "the paper's p = 2, more rays", lambda bake: f"{bake.rays}"),
    "brute force": ("#000000", "brute force", lambda _: ""),
    "Cycles": ("#E69F00", "Cycles, more samples", lambda bake: f"{bake.samples}"),
}
_INK, _PALE, _GRID = "#202020", "#707070", "#E0E0E0"
#: Where labels may be from a point: how far, in which direction, and which end of them is there. The nearest is best.
_BESIDE = [
    (far, dx, dy, "lm" if dx > 0 else "rm")
    for far in (14, 32, 50, 68)
    for dx, dy in ((0.7, -1), (0.7, 1.1), (-0.7, -1), (-0.7, 1.1), (1.2, 0), (-1.2, 0))
]
#: Free room around the points, as a factor.
_MARGIN = 1.5


class _Paper:
    """A drawing in pixels of the picture; every size is enlarged by SCALE."""

    def __init__(self) -> None:
        self.image = Image.new("RGB", tuple(SCALE * length for length in SIZE), "white")
        self._draw = ImageDraw.Draw(self.image)
        self._fonts = {size: ImageFont.load_default(SCALE * size) for size in (20, 34)}
        self._taken: list[tuple[float, float, float, float]] = []

    def line(self, points: list[tuple[float, float]], colour: str, width: float = 1.0) -> None:
        scaled = [(SCALE * x, SCALE * y) for x, y in points]
        self._draw.line(scaled, fill=colour, width=round(SCALE * width), joint="curve")

    def disc(self, at: tuple[float, float], radius: float, fill: str | None, edge: str, width: float = 2.0) -> None:
        (x, y), radius = (SCALE * at[0], SCALE * at[1]), SCALE * radius
        box = (x - radius, y - radius, x + radius, y + radius)
        self._draw.ellipse(box, fill=fill, outline=edge, width=round(SCALE * width))

    def text(self, at: tuple[float, float], text: str, size: int = 20, colour: str = _INK, anchor: str = "lm") -> None:
        self._draw.text((SCALE * at[0], SCALE * at[1]), text, fill=colour, font=self._fonts[size], anchor=anchor)

    def label(self, at: tuple[float, float], text: str, colour: str) -> None:
        """A small text beside a point, where no other label is in its way."""
        for far, dx, dy, anchor in _BESIDE:
            place = SCALE * (at[0] + far * dx), SCALE * (at[1] + far * dy)
            box = self._draw.textbbox(place, text, font=self._fonts[20], anchor=anchor)
            if not any(a < right and left < c and b < bottom and top < d for a, b, c, d in self._taken
                       for left, top, right, bottom in [box]):  # fmt: skip
                self._taken.append(box)
                if far > _BESIDE[0][0]:
                    self.line([at, (place[0] / SCALE, place[1] / SCALE)], colour)
                halo = {"stroke_width": 3 * SCALE, "stroke_fill": "white"}
                self._draw.text(place, text, fill=colour, font=self._fonts[20], anchor=anchor, **halo)
                return

    def keep_free(self, at: tuple[float, float], radius: float) -> None:
        """No label goes there."""
        (x, y), radius = (SCALE * at[0], SCALE * at[1]), SCALE * radius
        self._taken.append((x - radius, y - radius, x + radius, y + radius))

    def upright(self, at: tuple[float, float], text: str) -> None:
        """Text from bottom to top, centred."""
        box = self._fonts[20].getbbox(text)
        label = Image.new("RGB", (box[2] + 4, box[3] + 8), "white")
        ImageDraw.Draw(label).text((2, 2), text, fill=_INK, font=self._fonts[20])
        label = label.rotate(90, expand=True)
        self.image.paste(label, (round(SCALE * at[0] - label.width / 2), round(SCALE * at[1] - label.height / 2)))


class _Axes:
    """Where seconds and errors lie on the picture."""

    def __init__(self, bakes: tuple[Bake, ...]) -> None:
        self._x = _range([bake.seconds for bake in bakes])
        self._y = _range([bake.error for bake in bakes if bake.error > 0] or [1.0])

    def at(self, seconds: float, error: float) -> tuple[float, float]:
        left, top, right, bottom = _PLOT
        x, y = _share(seconds, self._x), _share(max(error, self._y[0]), self._y)
        return left + x * (right - left), bottom - y * (bottom - top)

    def draw(self, paper: _Paper, target: float) -> None:
        left, top, right, bottom = _PLOT
        for seconds in _ticks(self._x):
            x, _ = self.at(seconds, self._y[0])
            paper.line([(x, top), (x, bottom)], _GRID)
            paper.text((x, bottom + 22), f"{seconds:g}", anchor="mm")
        for error in _ticks(self._y):
            _, y = self.at(self._x[0], error)
            paper.line([(left, y), (right, y)], _GRID)
            paper.text((left - 14, y), f"{100 * error:g} %", anchor="rm")
        paper.line([(left, top), (left, bottom), (right, bottom)], _PALE, 1.5)
        if self._y[0] < target < self._y[1]:
            _, y = self.at(self._x[0], target)
            paper.line([(left, y), (right, y)], _PALE, 2.0)
            paper.text((right - 8, y - 16), f"wanted: {100 * target:g} %", colour=_PALE, anchor="rm")
        paper.text(((left + right) / 2, bottom + 60), "seconds of a bake", 20, anchor="mm")
        paper.upright((36, (top + bottom) / 2), "error of the light (RMS)")


def draw(study: Study, title: str) -> Image.Image:
    """The picture of a study, of `SIZE`."""
    paper, axes = _Paper(), _Axes(study.bakes)
    paper.text((_PLOT[0], 44), title, 34)
    paper.text((_PLOT[0], 86), study.why, 20, _PALE)
    axes.draw(paper, study.target)
    shown = [name for name in _SERIES if any(bake.series == name for bake in study.bakes)]
    labels = []
    for row, name in enumerate(shown):
        colour, label, value = _SERIES[name]
        bakes = [bake for bake in study.bakes if bake.series == name]
        places = [axes.at(bake.seconds, bake.error) for bake in bakes]
        paper.line(places, colour, 3.0)
        for place in places:
            paper.disc(place, 6, colour, "white", 1.0)
            paper.keep_free(place, 4)
        labels += [(place, value(bake), colour) for place, bake in zip(places, bakes, strict=True)]
        y = _PLOT[1] + 30 + 38 * row
        paper.line([(1262, y), (1302, y)], colour, 3.0)
        paper.disc((1282, y), 6, colour, "white", 1.0)
        paper.text((1314, y), label)
    best = axes.at(study.best.seconds, study.best.error)
    paper.keep_free(best, 14)
    for place, text, colour in labels:
        paper.label(place, text, colour)
    y = _PLOT[1] + 30 + 38 * len(shown)
    paper.disc(best, 14, None, _INK, 3.0)
    paper.disc((1282, y), 12, None, _INK, 3.0)
    paper.text((1314, y), "recommended")
    return paper.image.resize(SIZE, Image.Resampling.LANCZOS)


def _range(values: list[float]) -> tuple[float, float]:
    return min(values) / _MARGIN, max(values) * _MARGIN


def _share(value: float, limits: tuple[float, float]) -> float:
    low, high = map(math.log, limits)
    return (math.log(value) - low) / (high - low)


def _ticks(limits: tuple[float, float]) -> Iterator[float]:
    """1, 2 and 5 times powers of ten within limits; only powers where these are many."""
    low, high = (math.floor(math.log10(limit)) for limit in limits)
    steps = (1, 2, 5) if high - low < 4 else (1,)
    for power in range(low, high + 1):
        yield from (step * 10.0**power for step in steps if limits[0] <= step * 10.0**power <= limits[1])
