"""Films of a run: GIF and WebP by Pillow, MP4 by ffmpeg. Each picture is written as it is drawn."""

from __future__ import annotations

import subprocess
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from shutil import which
from typing import Any

import numpy as np

from ..base import Floats, check, files
from ..base.extras import import_from_extra
from ..base.progress import ProgressBar
from .label import Pixels
from .picture import Drawing, check_file_path, make_style

# Effort, 0 to 6; at 4 a film of 181 pictures is 2 % smaller and takes 1.5 times as long, at 6 15
# times.
WEBP_METHOD = 2
# Pixels of a picture's width that a GIF's palette is made from; as many as the default width.
PALETTE_WIDTH = 640
GIF_FPS = 50.0  # frames/s; browsers slow down a GIF whose frames are shorter than 0.02 s
FORMATS = (".gif", ".webp", ".mp4")


class Film:
    """The pictures of a film, drawn on demand. Equal consecutive pictures are drawn once."""

    def __init__(
        self, drawing: Drawing, shown: Sequence[int], fps: float, advance: Callable[[], object]
    ) -> None:
        self.drawing = drawing
        self.shown = shown
        self.fps = fps
        self._advance = advance
        self._counted = 0
        self._frame = -1
        self._pixels = np.empty((0, 0, 3), np.uint8)

    def __len__(self) -> int:
        return len(self.shown)

    def __getitem__(self, k: int) -> Pixels:
        if self.shown[k] != self._frame:
            self._frame = self.shown[k]
            self._pixels = self.drawing.pixels(self._frame)
        if k == self._counted:
            self._counted += 1
            self._advance()
        return self._pixels

    def durations_in_ms(self, tick: int) -> list[int]:
        """Return milliseconds of each picture: multiples of `tick` whose errors do not add up."""
        ends = np.round(np.arange(len(self) + 1) * 1000 / self.fps / tick).astype(int) * tick
        return [int(d) for d in np.diff(ends)]


def animate(
    run: Any,
    path: str | Path,
    fps: float = 30.0,
    speed: float = 1.0,
    progress: bool = False,
    **style: Any,
) -> Path:
    """Write a film, as `Run.animate` does; with `progress`, a bar counts pictures."""
    path = check_film_path("path", path)
    suffix = path.suffix.lower()
    fps = check.number(
        "fps", fps, minimum=0, exclusive=True, maximum=GIF_FPS if suffix == ".gif" else 240
    )
    speed = check.number("speed", speed, minimum=1e-9)
    if len(run.t) < 3:
        raise ValueError(
            f"a film needs at least 3 stored frames, this run has {len(run.t)}: "
            "simulate with every= (seconds or steps between frames)"
        )
    drawing = Drawing(run.scene, run.x, run.v, run.t, make_style(style))
    if suffix == ".mp4":  # H.264 halves the resolution of colour, so it wants even sides
        drawing.width -= drawing.width % 2
    shown = nearest_frames(run.t, fps, speed)
    seconds = float(run.t[-1] - run.t[0])
    write = {".gif": _write_gif, ".webp": _write_webp, ".mp4": _write_mp4}[suffix]
    with (
        ProgressBar.for_simulated_time(progress, seconds, "film") as bar,
        files.replace_when_complete(path) as part,
    ):
        write(part, Film(drawing, shown, fps, lambda: bar.advance(seconds / len(shown))))
    return path


def check_film_path(name: str, value: Any) -> Path:
    """Check that the film `value` can be written: its format, folder and program."""
    path = check_file_path(name, value)
    if path.suffix.lower() not in FORMATS:
        raise ValueError(f"{name} must end in one of {', '.join(FORMATS)}, got {str(path)!r}")
    _find_ffmpeg() if path.suffix.lower() == ".mp4" else import_from_extra(
        "PIL.Image", "a film", "plot"
    )
    return path


def nearest_frames(t: Floats, fps: float, speed: float) -> list[int]:
    """Return the nearest stored frame for each picture of a film."""
    count = max(2, round((t[-1] - t[0]) / speed * fps) + 1)
    times = np.minimum(t[0] + np.arange(count) * speed / fps, t[-1])
    following = np.searchsorted(t, times).clip(1, len(t) - 1)
    return [
        int(k)
        for k in np.where(
            times - t[following - 1] <= t[following] - times, following - 1, following
        )
    ]


class _Reel:
    """A film after its first picture, as the image of many frames from which Pillow takes one after
    the other.
    """

    def __init__(self, image: Any, film: Film) -> None:
        self._image = image
        self._film = film
        self.n_frames = len(film) - 1
        self._picture: Any = None

    def seek(self, k: int) -> None:
        self._picture = self._image.fromarray(self._film[k + 1])

    def __getattr__(self, name: str) -> Any:
        return getattr(self._picture, name)


def _write_webp(path: Path, film: Film) -> None:
    image = import_from_extra("PIL.Image", "a film", "plot")
    first = image.fromarray(film[0])
    options = {
        "save_all": True,
        "append_images": [_Reel(image, film)],
        "duration": film.durations_in_ms(1),
        "loop": 0,
    }
    first.save(path, format="WEBP", quality=85, method=WEBP_METHOD, **options)


def _write_gif(part: Path, film: Film) -> None:
    """Write a GIF with one palette for all pictures, since palettes of their own flicker. Of a
    picture, the changed rectangle is written.
    """
    image, gif, chops = (
        import_from_extra(f"PIL.{name}", "a film", "plot")
        for name in ("Image", "GifImagePlugin", "ImageChops")
    )
    palette = _make_common_palette(image, film)
    last = None
    with part.open("wb") as file:
        for k, duration in enumerate(film.durations_in_ms(10)):
            frame = image.fromarray(film[k]).quantize(palette=palette, dither=image.Dither.NONE)
            if last is None:
                file.writelines(gif.getheader(frame.copy(), info={"loop": 0})[0])
            # A picture that equals the last one still takes its time.
            box = (
                frame.getbbox()
                if last is None
                else chops.difference(frame, last).getbbox() or (0, 0, 1, 1)
            )
            area = (0, 0, *frame.size) if last is None else box
            file.writelines(gif.getdata(frame.crop(area), area[:2], duration=duration))
            last = frame
        file.write(b";")


def _make_common_palette(image: Any, film: Film) -> Any:
    """Return a palette of 255 colours for the whole film, from eight of its pictures."""
    chosen = sorted({film.shown[k] for k in np.linspace(0, len(film) - 1, 8).astype(int)})
    # Of wide pictures a part of the pixels: all of them hold Ctrl-C back for half a second.
    every = 1 + film.drawing.width // (PALETTE_WIDTH + 1)
    sheet = np.concatenate([film.drawing.pixels(k)[::every, ::every] for k in chosen])
    return image.fromarray(sheet).quantize(255, method=image.Quantize.MEDIANCUT)


def _find_ffmpeg() -> str:
    """Return the program on the PATH, or that of the package imageio-ffmpeg."""
    program = which("ffmpeg")
    if program is not None:
        return program
    with suppress(ImportError, RuntimeError):
        packaged: str = import_from_extra("imageio_ffmpeg", "an MP4 film", "film").get_ffmpeg_exe()
        return packaged
    raise RuntimeError(
        "an MP4 film needs ffmpeg, which is neither on the PATH nor in the package "
        "imageio-ffmpeg: install the program (Debian, Ubuntu: apt-get install ffmpeg) or run pip "
        "install 'clothsim[film]', or write .webp or .gif instead"
    )


def _write_mp4(path: Path, film: Film) -> None:
    height, width, _ = film[0].shape
    source = (
        f"-y -loglevel error -f rawvideo -pix_fmt rgb24 -s {width}x{height + height % 2} -r "
        f"{film.fps!r} -i -"
    )
    target = "-an -vcodec libx264 -pix_fmt yuv420p -crf 18 -movflags +faststart"
    command = [_find_ffmpeg(), *source.split(), *target.split(), str(path.absolute())]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as ffmpeg:
        assert ffmpeg.stdin is not None and ffmpeg.stderr is not None
        try:
            for k in range(len(film)):
                pixels = film[k]
                ffmpeg.stdin.write(pixels.data)
                if height % 2:  # a black row would be an edge
                    ffmpeg.stdin.write(pixels[-1].data)
        except BrokenPipeError:
            pass  # ffmpeg says on stderr why it stopped
        except BaseException:
            ffmpeg.kill()  # else Ctrl-C waits until it has written what it has
            raise
        with suppress(BrokenPipeError):
            ffmpeg.stdin.close()
        said = ffmpeg.stderr.read().decode(errors="replace").strip()
    if ffmpeg.returncode:
        raise RuntimeError(f"ffmpeg could not write {str(path)!r}: {said or ffmpeg.returncode}")
