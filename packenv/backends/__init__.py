"""Run many jobs in this process, on worker processes or on Ray: the same outcomes from each of them."""

from .outcome import BackendName, Outcome, Status
from .run import imap_unordered

__all__ = ["BackendName", "Outcome", "Status", "imap_unordered"]
