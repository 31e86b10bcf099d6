"""The verifier: is a path free, with what does it collide, how near does it come; whoever planned it."""

from trailmark.verify.auditor import PathAuditor, check_path
from trailmark.verify.repair import repaired
from trailmark.verify.result import Collision, PathAudit, Undrivable
from trailmark.verify.verifier import RIM, Verifier

__all__ = ["RIM", "Collision", "PathAudit", "PathAuditor", "Undrivable", "Verifier", "check_path", "repaired"]
