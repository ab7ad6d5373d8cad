"""The figure that plots draw on. Import it where something is drawn: it loads Matplotlib."""

from __future__ import annotations

from io import BytesIO

from matplotlib.figure import Figure


class NotebookFigure(Figure):
    """A figure without pyplot, so that nothing global holds it, which notebooks show all the same."""

    def _repr_png_(self) -> bytes:
        """What IPython and its kin show."""
        picture = BytesIO()
        self.savefig(picture, format="png")
        return picture.getvalue()
