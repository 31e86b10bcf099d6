"""Audits of paths, whoever planned them: is a path free, with what does it collide, how near does it come."""

from trailmark.audit.auditor import PathAuditor, check_path
from trailmark.audit.result import Collision, PathAudit, Undrivable

__all__ = ["Collision", "PathAudit", "PathAuditor", "Undrivable", "check_path"]
