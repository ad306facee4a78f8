"""Pictures of the gallery: each example writes its own into the working directory."""

import shutil
from pathlib import Path
from typing import Any

from PIL import Image
from sphinx_gallery.scrapers import figure_rst


class PictureFiles:
    """Move the pictures and films that an example wrote into its page."""

    def __repr__(self) -> str:
        return "PictureFiles"  # an address would make Sphinx build every page again

    def __call__(self, block: Any, variables: dict[str, Any], gallery: dict[str, Any]) -> str:
        """Return the lines that show the files; Sphinx-gallery calls this after each code block."""
        pictures = []
        for path in sorted(
            Path(variables["src_file"]).parent.glob("*.*"), key=lambda path: path.stat().st_mtime_ns
        ):
            if path.suffix in (".png", ".webp"):
                still = Path(next(variables["image_path_iterator"]))
                pictures.append(still.with_suffix(path.suffix))
                shutil.move(path, pictures[-1])
                if path.suffix == ".webp":  # the thumbnail is the last frame of a film
                    with Image.open(pictures[-1]) as film:
                        film.seek(film.n_frames - 1)
                        film.save(still)
        title = Path(variables["src_file"]).read_text(encoding="utf8").split("\n")[1]
        return figure_rst(pictures, gallery["src_dir"], title)
