"""Ink on paper: pictures, posters, pages, book spines."""

from __future__ import annotations

import numpy as np

from eres_render.textures.fractal_noise import Float32, fractal_noise

# Capital letters, 5 columns of 7 dots each, the lowest bit on top.
_ALPHABET = "ABCDEFGHIJKLMNOPQRSTUVWXYZ"
_DOTS = bytes.fromhex(
    "7e1111117e 7f49494936 3e41414122 7f4141221c 7f49494941 7f09090901 3e4149497a 7f0808087f"
    "00417f4100 2040413f01 7f08142241 7f40404040 7f020c027f 7f0408107f 3e4141413e 7f09090906"
    "3e4151215e 7f09192946 4649494931 01017f0101 3f4040403f 1f2040201f 3f4038403f 6314081463"
    "0708700807 6151494543"
)
_LETTERS = {letter: _DOTS[5 * i : 5 * i + 5] for i, letter in enumerate(_ALPHABET)}
_TITLES = (
    "OPTICS", "ON GROWTH AND FORM", "LIGHT", "EUCLID", "THE ORIGIN OF SPECIES", "DON QUIXOTE",
    "FAUST", "THE TEMPEST", "MICROGRAPHIA", "COSMOS", "HARMONY OF THE WORLD", "WAR AND PEACE",
    "MIDDLEMARCH", "DEAD SOULS", "ATLAS", "FLORA", "CANDIDE", "EMMA", "DRACULA", "GRAMMAR",
    "THE STARRY MESSENGER", "MOBY DICK", "ELEMENTS", "HERBAL", "SHADOWS", "PERSPECTIVE",
)  # fmt: skip


def lettering(text: str, height_px: int) -> Float32:
    """Return text in capitals as the ink's coverage."""
    columns: list[int] = []
    for letter in text:
        columns += [*_LETTERS.get(letter, b"\0\0"), 0]
    bits = np.array(columns, dtype=np.uint8)[None, :] >> np.arange(7, dtype=np.uint8)[:, None] & 1
    width = max(1, round(len(columns) * height_px / 7))
    smooth = _resize(bits.astype(np.float32), (height_px, width))
    return np.clip(3 * (smooth - 0.5) + 0.5, 0, 1, dtype=np.float32)


def _resize(image: Float32, shape: tuple[int, int]) -> Float32:
    import cv2

    method = cv2.INTER_AREA if shape[1] < image.shape[1] else cv2.INTER_CUBIC
    return cv2.resize(image, shape[::-1], interpolation=method).astype(np.float32, copy=False)


def _stamp(image: Float32, ink: float, mask: Float32, top: int, left: int) -> None:
    """Print a mask in an ink, clipped to the image."""
    part = image[max(top, 0) : top + mask.shape[0], max(left, 0) : left + mask.shape[1]]
    cut = mask[max(-top, 0) :, max(-left, 0) :][: part.shape[0], : part.shape[1]]
    part += cut * (np.float32(ink) - part)


def _on_paper(image: Float32, rng: np.random.Generator) -> Float32:
    """Add the grain of paper and ink."""
    image *= np.exp(0.05 * rng.standard_normal(image.shape, dtype=np.float32))
    return image


def book_spine(shape: tuple[int, int], texel_m: float, rng: np.random.Generator) -> Float32:
    """Return a bound spine: cloth or leather, bands, a title that runs along it."""
    height, width = shape
    tone = float(rng.choice([0.06, 0.09, 0.14, 0.2, 0.3, 0.42, 0.6]))
    ink = 0.7 if tone < 0.25 else 0.05
    cloth = 0.14 * fractal_noise(shape, 12, 1, rng)
    spine = np.exp(np.log(tone) + cloth, dtype=np.float32)
    bend = np.sin(np.pi * (np.arange(width, dtype=np.float32) + 0.5) / width)
    spine *= 0.75 + 0.25 * bend
    for at in rng.choice([0.08, 0.12, 0.16, 0.8, 0.86, 0.9], size=3, replace=False):
        row = int(at * height)
        spine[row : row + max(2, height // 90)] = ink
    letters = max(7, int(rng.uniform(0.26, 0.40) * width))
    title = lettering(str(rng.choice(_TITLES)), letters)
    room = int(0.56 * height)
    if title.shape[1] > room:
        title = _resize(title, (letters, room))
    along = np.rot90(title, -1)
    _stamp(spine, ink, along, int(0.22 * height), (width - letters) // 2)
    mark = lettering("".join(rng.choice(list(_LETTERS), 2)), max(7, int(0.22 * width)))
    _stamp(spine, ink, mark, int(0.93 * height), (width - mark.shape[1]) // 2)
    return _on_paper(spine, rng)


def book_cover(shape: tuple[int, int], texel_m: float, rng: np.random.Generator) -> Float32:
    """Return a cover: cloth with a title and a frame."""
    tone = float(rng.choice([0.08, 0.14, 0.25, 0.5]))
    ink = 0.7 if tone < 0.2 else 0.06
    cover = np.exp(np.log(tone) + 0.14 * fractal_noise(shape, 12, 1, rng), dtype=np.float32)
    height, width = shape
    inset = max(3, round(0.2 * min(shape)))
    for edge in (inset, inset + 4):
        cover[edge : edge + 2, edge:-edge] = ink
        cover[-edge - 2 : -edge, edge:-edge] = ink
        cover[edge:-edge, edge : edge + 2] = ink
        cover[edge:-edge, -edge - 2 : -edge] = ink
    title = lettering(str(rng.choice(_TITLES)), max(7, height // 12))
    if title.shape[1] > 0.5 * width:
        title = _resize(title, (title.shape[0], width // 2))
    _stamp(cover, ink, title, height // 3, (width - title.shape[1]) // 2)
    return _on_paper(cover, rng)


def book_pages(shape: tuple[int, int], texel_m: float, rng: np.random.Generator) -> Float32:
    """Return the cut edges of pages."""
    sheets = 0.22 * rng.standard_normal((1, shape[1]), dtype=np.float32)
    grain = 0.06 * rng.standard_normal(shape, dtype=np.float32)
    return np.exp(np.log(0.6) + sheets + grain, dtype=np.float32)


def text_page(shape: tuple[int, int], texel_m: float, rng: np.random.Generator) -> Float32:
    """Return a printed page: a heading, columns of lines of words, a woodcut."""
    height, width = shape
    page = np.full(shape, 0.72, dtype=np.float32)
    line, margin = max(6, round(0.009 / texel_m)), round(0.05 / texel_m)
    heading = lettering(str(rng.choice(_TITLES)), max(7, round(0.022 / texel_m)))
    if heading.shape[1] > width - 2 * margin:
        heading = _resize(heading, (heading.shape[0], width - 2 * margin))
    _stamp(page, 0.05, heading, margin, margin)
    picture = range(int(0.55 * height), int(0.8 * height))
    for top in range(margin + round(0.04 / texel_m), height - margin, line):
        if top in picture:
            continue
        left = margin
        while left < width - margin - 4:
            word = "".join(rng.choice(list(_LETTERS), int(rng.integers(2, 9))))
            mask = lettering(word, max(4, int(0.6 * line)))
            _stamp(page, 0.08, mask[:, : width - margin - left], top, left)
            left += mask.shape[1] + line // 3
    cut = fractal_noise(shape, 24, 2, rng)[picture.start : picture.stop, margin:-margin]
    page[picture.start : picture.stop, margin:-margin] = np.where(cut > 0, 0.7, 0.07)
    return _on_paper(page, rng)


def landscape(shape: tuple[int, int], texel_m: float, rng: np.random.Generator) -> Float32:
    """Return a painting of hills behind hills under clouds, in visible brush strokes."""
    height, width = shape
    clouds = fractal_noise(shape, 0.5 * width, 4, rng)
    sky = np.linspace(0.30, 0.72, height, dtype=np.float32)[:, None]
    image = sky * np.exp(0.25 * np.maximum(clouds, 0) - 0.08, dtype=np.float32)
    row = np.arange(height, dtype=np.float32)[:, None]
    for k in range(6):
        ridge = fractal_noise((4, width), 0.4 * width, 3, rng, fall=0.5)[0]
        crest = height * (0.36 + 0.10 * k + (0.07 - 0.006 * k) * ridge)
        texture = fractal_noise(shape, 30, 1, rng)
        tone = 0.36 * 0.72**k
        hill = tone * np.exp(0.2 * texture + 0.5 * np.exp(-np.abs(row - crest) / (0.04 * height)))
        image = np.where(row > crest, np.minimum(hill, 0.8), image)
    strokes = fractal_noise(shape, 6, 1, rng, stretch=0.3)
    return (image * np.exp(0.14 * strokes)).astype(np.float32)


def abstract(shape: tuple[int, int], texel_m: float, rng: np.random.Generator) -> Float32:
    """Return a painting of rectangles and discs, outlined, on canvas."""
    import cv2

    image = np.full(shape, 0.6, dtype=np.float32)
    height, width = shape
    for _ in range(26):
        tone = float(rng.choice([0.06, 0.12, 0.22, 0.4, 0.72]))
        y, x = int(rng.integers(height)), int(rng.integers(width))
        h, w = (int(rng.integers(side // 14, side // 3)) for side in shape)
        if rng.random() < 0.6:
            cv2.rectangle(image, (x, y), (x + w, y + h), 0.04, -1)
            cv2.rectangle(image, (x + 5, y + 5), (x + w - 5, y + h - 5), tone, -1)
        else:
            cv2.circle(image, (x, y), min(h, w) // 2, 0.04, -1)
            cv2.circle(image, (x, y), max(1, min(h, w) // 2 - 5), tone, -1)
    canvas = np.arange(height)[:, None] // 2 % 2 + np.arange(width) // 2 % 2
    strokes = fractal_noise(shape, 8, 1, rng)
    return (image * np.exp(0.06 * (canvas - 1) + 0.13 * strokes)).astype(np.float32)


def poster(shape: tuple[int, int], texel_m: float, rng: np.random.Generator) -> Float32:
    """Return a poster: large words over fine print, a sun of rays."""
    height, width = shape
    y, x = np.mgrid[:height, :width].astype(np.float32)
    angle = np.arctan2(y - 0.42 * height, x - 0.5 * width)
    radius = np.hypot(y - 0.42 * height, x - 0.5 * width) / width
    image = np.where(np.sin(18 * angle) > 0, 0.55, 0.16).astype(np.float32)
    image = np.where(radius < 0.22, 0.75, image)
    image = np.where(radius < 0.20, 0.07, image)
    image = np.where((radius * 40).astype(int) % 2 == 0, image, 0.9 * image).astype(np.float32)
    image[int(0.74 * height) :] = 0.7
    for k, word in enumerate(("EVENTS", "LIGHT AND TIME")):
        mask = lettering(word, height // 10)
        mask = _resize(mask, (height // (10 + 6 * k), int(0.8 * width)))
        _stamp(image, 0.05, mask, int((0.77 + 0.12 * k) * height), int(0.1 * width))
    return _on_paper(image, rng)
