"""The figure class that plots use. Import this module only where something is drawn, for it loads Matplotlib."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import Any

from matplotlib import rc_context
from matplotlib.figure import Figure


class NotebookFigure(Figure):
    """A figure that is not registered with pyplot, so that it is freed when unused, but that notebooks still show."""

    def savefig(self, fname: Any, **options: Any) -> None:
        """Writes a picture. In a vector file texts stay texts, in fonts that publishers accept, and only the maps are bitmaps."""
        if isinstance(fname, (str, Path)) and str(fname).lower().endswith((".pdf", ".svg")):
            options = {"dpi": 300, **options}
        with rc_context({"pdf.fonttype": 42, "svg.fonttype": "none"}):
            super().savefig(fname, **options)

    def _repr_png_(self) -> bytes:
        """The picture that IPython and notebooks show."""
        picture = BytesIO()
        self.savefig(picture, format="png")
        return picture.getvalue()
