"""Pictures of the gallery: each example writes its own into the working directory."""

import shutil
from pathlib import Path
from typing import Any

from sphinx_gallery.scrapers import figure_rst


class PictureFiles:
    """Move the pictures and films that an example wrote into its page."""

    def __repr__(self) -> str:
        return "PictureFiles"  # an address would make Sphinx build every page again

    def __call__(self, block: Any, variables: dict[str, Any], gallery: dict[str, Any]) -> str:
        """Return the lines that show the files; Sphinx-gallery calls this after each block of code."""
        shown = []
        for path in sorted(Path(gallery["src_dir"], "examples").glob("*.*")):
            if path.suffix in (".png", ".webp"):
                target = Path(next(variables["image_path_iterator"])).with_suffix(path.suffix)
                shutil.move(path, target)
                shown.append(target)
        return figure_rst(shown, gallery["src_dir"])
