"""Audits of paths, whoever planned them: names of :mod:`trailmark.verify`."""

from trailmark.verify import Collision, PathAudit, PathAuditor, Undrivable, check_path, repaired

__all__ = ["Collision", "PathAudit", "PathAuditor", "Undrivable", "check_path", "repaired"]
