"""Writers of frames into files: GIF and HTML by Pillow alone, MP4 by the program ffmpeg."""

from __future__ import annotations

import base64
import contextlib
import io
import json
import shutil
import subprocess
from collections.abc import Callable, Iterator
from importlib import resources
from pathlib import Path
from typing import Protocol

import numpy as np
from PIL import Image
from scipy.spatial import KDTree

from coopmm_jax.errors import UserError
from coopmm_jax.files import write_text

COLOURS = 96  # of a palette: the pictures are flat areas and their smoothed edges
GREYS = np.repeat(np.array([[89], [128], [166], [204], [230]], np.uint8), 3, axis=1)  # of text, curves and grids
SAMPLED = 12  # frames from which the palette is chosen
PAUSE = 1.0  # [s] on the last frame before a GIF starts again


class Frames(Protocol):
    """A sequence of pictures (height, width, 3), uint8, of one size."""

    fps: float
    colours: np.ndarray  # (n, 3), uint8, that must be exact, however few pixels have them
    cuts: list[int]  # [pixel] from the left, between parts that a narrow screen shows one by one

    def __len__(self) -> int: ...

    def picture(self, k: int) -> np.ndarray:
        """Frame k."""
        ...


Writer = Callable[[Frames, Path], None]


def write_gif(frames: Frames, path: Path) -> None:
    """Write an animated GIF that repeats for ever; all frames share one palette, so only changes are stored."""
    pictures = indexed(frames)
    ends = np.round(100.0 * np.arange(1, len(frames) + 1) / frames.fps).astype(int)  # a GIF's clock has 1/100 s
    durations = 10 * np.diff(ends, prepend=0)
    durations[-1] += round(1000 * PAUSE)
    # With optimize, what is as in the frame before becomes transparent: a third of the size.
    look = {"save_all": True, "loop": 0, "disposal": 1, "optimize": True}
    next(pictures).save(path, append_images=pictures, duration=durations.tolist(), **look)


def write_html(frames: Frames, path: Path) -> None:
    """Write a self-contained page with a player: the background, and of each frame what differs from it."""
    palette = np.concatenate([frames.colours, GREYS])  # few, which halves the page
    entry = _nearest(palette, exact=len(palette))
    still = _still(frames, entry)
    pictures = [_encoded(palette[still], np.ones(still.shape, bool))]
    for k in range(len(frames)):
        drawn = entry[_bin(frames.picture(k))]
        pictures.append(_encoded(palette[drawn], drawn != still))
    height, width = still.shape
    about = {"fps": frames.fps, "width": width, "height": height, "cuts": [0, *frames.cuts, width]}
    player = (resources.files("coopmm_jax") / "animation" / "player.html").read_text(encoding="utf-8")
    write_text(
        path,
        player.replace("$FRAMES", json.dumps(pictures))
        .replace("$ABOUT", json.dumps(about))
        .replace("$WIDTH", str(width)),
    )


def write_mp4(frames: Frames, path: Path) -> None:
    """Write a film by ffmpeg, with its codec for the file's suffix.

    Raises:
        UserError: ffmpeg is not installed, or it fails.
    """
    height, width, _ = frames.picture(0).shape
    raw = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", f"{frames.fps:g}", "-i", "-"]
    film = ["-pix_fmt", "yuv420p", str(path)]
    command = [find_ffmpeg(), "-y", "-loglevel", "error", *raw, *film]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdin is not None  # as it is a pipe
        with contextlib.suppress(BrokenPipeError):  # it gave up, and gives its reason on stderr
            for k in range(len(frames)):
                process.stdin.write(frames.picture(k).tobytes())
        _, complaint = process.communicate()
    if process.returncode:
        raise UserError("--out", "a film that ffmpeg can write", f"refused: {complaint.decode(errors='replace')}")


WRITERS: dict[str, Writer] = {".gif": write_gif, ".html": write_html, ".mp4": write_mp4}


def find_ffmpeg() -> str:
    """Path of ffmpeg.

    Raises:
        UserError: ffmpeg is not installed.
    """
    found = shutil.which("ffmpeg")
    if found is None:
        raise UserError("--out", "a .gif or .html file where ffmpeg is not installed", "an .mp4 file")
    return found


def indexed(frames: Frames) -> Iterator[Image.Image]:
    """Frames that share one palette: first the colours that must be exact, then those of a few frames."""
    palette = _palette(frames)
    entry = _nearest(palette, exact=len(frames.colours))
    for k in range(len(frames)):
        image = Image.fromarray(entry[_bin(frames.picture(k))])
        image.putpalette(palette.tobytes())
        yield image


def _still(frames: Frames, entry: np.ndarray) -> np.ndarray:
    """Background (height, width): the palette's entry that each pixel shows most often, in a few frames."""
    sampled = np.unique(np.linspace(0, len(frames) - 1, SAMPLED).astype(int))
    shown = np.sort(np.stack([entry[_bin(frames.picture(k))] for k in sampled]), axis=0)
    times = np.stack([np.sum(shown == one, axis=0, dtype=np.uint8) for one in shown])
    return np.take_along_axis(shown, times.argmax(axis=0)[None], axis=0)[0]


def _encoded(colours: np.ndarray, shown: np.ndarray) -> str:
    """Picture (height, width, 3) as lossless WebP in base64, transparent where it is not to be shown."""
    stream = io.BytesIO()
    pixels = np.dstack([colours, np.full(shown.shape, 255, np.uint8)])
    pixels[~shown] = 0
    Image.fromarray(pixels).save(stream, "webp", lossless=True, quality=20, method=1)
    return base64.b64encode(stream.getvalue()).decode("ascii")


def _palette(frames: Frames) -> np.ndarray:
    """Red, green and blue (n, 3), uint8, of at most ``COLOURS`` colours, the exact ones first."""
    sampled = np.unique(np.linspace(0, len(frames) - 1, SAMPLED).astype(int))
    together = Image.fromarray(np.concatenate([frames.picture(k) for k in sampled]))
    others = together.quantize(COLOURS - len(frames.colours)).getpalette() or []
    return np.concatenate([frames.colours, np.reshape(others, (-1, 3))]).astype(np.uint8)


def _nearest(palette: np.ndarray, exact: int) -> np.ndarray:
    """Palette entry (2^15,) of each bin; a bin that holds one of the first ``exact`` colours takes that colour."""
    channel = 8 * np.arange(32) + 4
    centres = np.stack(np.meshgrid(channel, channel, channel, indexing="ij"), axis=-1).reshape(-1, 3)
    entry = np.asarray(KDTree(palette).query(centres)[1])
    entry[_bin(palette[:exact])] = np.arange(exact)
    return entry.astype(np.uint8)


def _bin(colours: np.ndarray) -> np.ndarray:
    """Number (...) of a colour (..., 3) by the five highest bits of its red, green and blue."""
    red, green, blue = np.moveaxis(colours >> 3, -1, 0).astype(np.uint16)
    return red << 10 | green << 5 | blue
