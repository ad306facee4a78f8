"""Films of a run: GIF and WebP by Pillow, MP4 by ffmpeg."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator, Sequence
from contextlib import suppress
from itertools import chain
from pathlib import Path
from shutil import which
from typing import Any

import numpy as np
import numpy.typing as npt

from ..base import check, files
from ..base.extras import needed
from ..base.progress import ProgressBar
from .camera import camera_for
from .picture import WIDEST, Picture, draw, file_path

GIF_FPS = 50.0  # frames/s; browsers slow down a GIF whose frames are shorter than 0.02 s
FORMATS = (".gif", ".webp", ".mp4")


def animate(
    run: Any,
    path: str | Path,
    fps: float = 30.0,
    speed: float = 1.0,
    camera: Any = None,
    width: int = 640,
    progress: bool = False,
) -> Path:
    """`Run.animate`; with `progress`, a bar counts pictures."""
    path = film_path("path", path)
    suffix = path.suffix.lower()
    fps = check.number("fps", fps, minimum=0, exclusive=True, maximum=GIF_FPS if suffix == ".gif" else 240)
    speed = check.number("speed", speed, minimum=0, exclusive=True)
    width = check.integer("width", width, minimum=16, maximum=WIDEST)
    if len(run.t) < 3:
        raise ValueError(
            f"a film needs at least 3 stored frames, this run has {len(run.t)}: "
            "simulate with every= (seconds or steps between frames)"
        )
    write = _write_mp4 if suffix == ".mp4" else _write_images
    camera = camera_for(camera, run.scene, run.x, run.t)
    shown = shown_frames(run.t, fps, speed)
    # H.264 halves the resolution of colour, so it wants even sides; a black row would be an edge.
    even = suffix == ".mp4"
    pictures = _drawn(run, shown, camera, width - width % 2 if even else width, even)
    with ProgressBar(progress, total=len(shown), unit="picture", desc="film") as bar, files.replacing(path) as part:
        write(part, bar.count(pictures), len(shown), fps)
    return path


def film_path(name: str, value: Any) -> Path:
    """Check that the film `value` can be written: its format, folder and program."""
    path = file_path(name, value)
    suffix = path.suffix.lower()
    if suffix not in FORMATS:
        raise ValueError(f"{name} must end in one of {', '.join(FORMATS)}, got {str(path)!r}")
    if suffix == ".mp4":
        _ffmpeg()
    else:
        needed("PIL.Image", f"a film as {suffix!r}", "plot")
    return path


def shown_frames(t: npt.NDArray[np.float64], fps: float, speed: float) -> list[int]:
    """The nearest stored frame for each picture of a film."""
    count = max(2, round((t[-1] - t[0]) / speed * fps) + 1)
    times = np.minimum(t[0] + np.arange(count) * speed / fps, t[-1])
    after = np.searchsorted(t, times).clip(1, len(t) - 1)
    return [int(k) for k in np.where(times - t[after - 1] <= t[after] - times, after - 1, after)]


def _drawn(run: Any, shown: Sequence[int], camera: Any, width: int, even: bool) -> Iterator[Picture]:
    last, picture = -1, None
    for k in shown:
        if k != last or picture is None:
            picture = draw(run.scene, run.x[k], float(run.t[k]), camera, width)
            if even and picture.pixels.shape[0] % 2:
                picture = Picture(np.concatenate([picture.pixels, picture.pixels[-1:]]))
            last = k
        yield picture


def _write_images(path: Path, pictures: Iterator[Picture], count: int, fps: float) -> None:
    image = needed("PIL.Image", f"a film as {path.suffix!r}", "plot")
    frames = [image.fromarray(picture.pixels) for picture in pictures]
    # Durations are whole milliseconds (GIF: hundredths): their sum follows the clock, none drifts.
    tick = 10 if path.suffix.lower() == ".gif" else 1
    ends = np.round(np.arange(count + 1) * 1000 / fps / tick).astype(int) * tick
    options = {"save_all": True, "append_images": frames[1:], "loop": 0}
    durations = [int(d) for d in np.diff(ends)]
    if path.suffix.lower() == ".gif":
        # One palette for all frames: palettes of their own flicker.
        palette = _common_palette(image, frames)
        frames = [f.quantize(palette=palette, dither=image.Dither.NONE) for f in frames]
        options["append_images"] = frames[1:]
    else:
        options.update(quality=85, method=4)
    frames[0].save(path, duration=durations, **options)


def _common_palette(image: Any, frames: Sequence[Any]) -> Any:
    """A palette of 256 colours for the whole film."""
    chosen = [frames[k] for k in np.linspace(0, len(frames) - 1, min(8, len(frames))).astype(int)]
    width, height = frames[0].size
    sheet = image.new("RGB", (width, height * len(chosen)))
    for k, frame in enumerate(chosen):
        sheet.paste(frame, (0, k * height))
    return sheet.quantize(255, method=image.Quantize.MEDIANCUT)


def _ffmpeg() -> str:
    program = which("ffmpeg")
    if program is None:
        raise RuntimeError(
            "an MP4 film needs the program ffmpeg, which is not on the PATH: install it "
            "(Debian, Ubuntu: apt-get install ffmpeg), or write .webp or .gif instead"
        )
    return program


def _write_mp4(path: Path, pictures: Iterator[Picture], count: int, fps: float) -> None:
    program = _ffmpeg()
    first = next(pictures)
    height, width, _ = first.pixels.shape
    command = [
        program,
        "-y",
        "-loglevel",
        "error",
        "-f",
        "rawvideo",
        "-pix_fmt",
        "rgb24",
        "-s",
        f"{width}x{height}",
        "-r",
        repr(fps),
        "-i",
        "-",
        "-an",
        "-vcodec",
        "libx264",
        "-pix_fmt",
        "yuv420p",
        "-crf",
        "18",
        "-movflags",
        "+faststart",
        str(path.absolute()),
    ]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as ffmpeg:
        assert ffmpeg.stdin is not None and ffmpeg.stderr is not None
        with suppress(BrokenPipeError):  # ffmpeg says on stderr why it stopped
            for picture in chain([first], pictures):
                ffmpeg.stdin.write(picture.pixels.tobytes())
        with suppress(BrokenPipeError):
            ffmpeg.stdin.close()
        said = ffmpeg.stderr.read().decode(errors="replace").strip()
    if ffmpeg.returncode:
        raise RuntimeError(f"ffmpeg could not write {str(path)!r}: {said or ffmpeg.returncode}")
