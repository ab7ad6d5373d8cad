"""The figure that plots draw on. Import it where something is drawn: it loads Matplotlib."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import Any

from matplotlib import rc_context
from matplotlib.figure import Figure


class NotebookFigure(Figure):
    """A figure without pyplot, so that nothing global holds it, which notebooks show all the same."""

    def savefig(self, fname: Any, **options: Any) -> None:
        """Writes a picture; in a vector file texts stay texts, in fonts that publishers take, and only the maps are dots."""
        if isinstance(fname, (str, Path)) and str(fname).lower().endswith((".pdf", ".svg")):
            options = {"dpi": 300, **options}
        with rc_context({"pdf.fonttype": 42, "svg.fonttype": "none"}):
            super().savefig(fname, **options)

    def _repr_png_(self) -> bytes:
        """What IPython and its kin show."""
        picture = BytesIO()
        self.savefig(picture, format="png")
        return picture.getvalue()
