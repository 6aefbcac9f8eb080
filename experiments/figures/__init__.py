"""The paper's figures, redone with the items of any catalogue."""

from .figure import Figure
from .write import write_figures

__all__ = ["Figure", "write_figures"]
